"""What a function that watches a training returns to stop it."""

from typing import Final, final


@final
class Stop:
    """The type of ``pinc.STOP``."""

    def __repr__(self) -> str:
        return "pinc.STOP"

    def __reduce__(self) -> str:
        return "STOP"


STOP: Final = Stop()
