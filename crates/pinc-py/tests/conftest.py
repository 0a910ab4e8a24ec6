"""What the tests share."""

from pathlib import Path

import pytest

import pinc_nmpc as pinc

CONFIGS = Path(__file__).resolve().parents[3] / "configs"
SMOKE = CONFIGS / "smoke" / "van-der-pol.toml"


@pytest.fixture(scope="session")
def smoke() -> Path:
    """A config that takes a second."""
    return SMOKE


@pytest.fixture(scope="session")
def done(tmp_path_factory: pytest.TempPathFactory) -> pinc.Run:
    """The run of it."""
    return pinc.run(SMOKE, tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="session")
def model(done: pinc.Run) -> pinc.Model:
    """Its net."""
    return done.model
