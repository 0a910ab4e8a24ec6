"""Trainings."""

import os
import signal
import threading
from pathlib import Path

import numpy as np
import pytest

import pinc_nmpc as pinc


def test_the_net_matches_the_net_of_a_run(smoke: Path, done: pinc.Run) -> None:
    seen: list[pinc.TrainingProgress] = []
    trained = pinc.train(smoke, progress=seen.append)
    assert trained.model.to_bytes() == done.model.to_bytes()
    assert trained.stop_reason == done.metrics["training"]["stop_reason"]
    assert trained.validation["mse_gen"] == done.metrics["validation"]["mse_gen"]
    assert trained.validation["measured_mse"] is None
    assert [now.iteration for now in seen] == list(range(1, trained.iterations + 1))
    assert seen[-1].iterations == 300
    assert seen[-1].loss < 0.1 * seen[0].loss
    assert seen[-1].validation_mse is not None and seen[0].validation_mse is None
    assert trained.loss_evaluations >= trained.iterations and trained.wall_s > 0
    assert "after" in repr(trained) and "300" in repr(seen[-1])


def test_a_text_and_overrides(smoke: Path) -> None:
    text = smoke.read_text(encoding="utf-8")
    few = {"training.phases.0.iterations": 3}
    by_text, by_path = pinc.train(text, few), pinc.train(str(smoke), few)
    assert by_text.iterations == 3
    assert by_text.model.to_bytes() == by_path.model.to_bytes()
    other = pinc.train(smoke, few | {"seed": 8, "domain.input_high": (0.9,), "name": "other"})
    assert other.model.domain["u"] == (-1.0, 0.9)


def test_none_takes_a_key_away(smoke: Path) -> None:
    with pytest.raises(pinc.InputError, match="missing"):
        pinc.train(smoke, {"model.neurons": None})
    with pytest.raises(pinc.InputError, match="overrides, without model.nothing: there is no key"):
        pinc.train(smoke, {"model.nothing": None})


def test_progress_can_stop_it(smoke: Path) -> None:
    trained = pinc.train(smoke, progress=lambda now: pinc.STOP if now.iteration == 20 else None)
    assert (trained.stop_reason, trained.iterations) == ("stopped", 20)
    assert trained.model.step([0.0, 0.0], [0.0]).shape == (2,)


@pytest.mark.parametrize("value", [False, 0, "", [], float("nan"), np.zeros(2)])
def test_no_other_value_stops_it(smoke: Path, value: object) -> None:
    few = {"training.phases.0.iterations": 3}
    trained = pinc.train(smoke, few, progress=lambda now: value)
    assert trained.iterations == 3 and trained.stop_reason != "stopped"


def test_what_progress_raises_is_raised(smoke: Path) -> None:
    def fails(now: pinc.TrainingProgress) -> None:
        raise LookupError(str(now.iteration))

    with pytest.raises(LookupError, match="^1$"):
        pinc.train(smoke, progress=fails)
    with pytest.raises(TypeError, match="not callable"):
        pinc.train(smoke, progress=3)  # type: ignore[arg-type]


def test_ctrl_c_ends_it(smoke: Path) -> None:
    def interrupts(now: pinc.TrainingProgress) -> None:
        if now.iteration == 5:
            os.kill(os.getpid(), signal.SIGINT)

    long = {"training.phases.0.iterations": 1_000_000}
    with pytest.raises(KeyboardInterrupt):
        pinc.train(smoke, long, interrupts)
    # Without a function to call, too.
    main = threading.main_thread().ident
    assert main is not None
    timer = threading.Timer(0.5, signal.pthread_kill, (main, signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        pinc.train(smoke, long)
    timer.join()


def test_bad_configs_are_refused(smoke: Path, tmp_path: Path) -> None:
    text = smoke.read_text(encoding="utf-8")
    for config, overrides, message in [
        (tmp_path / "none.toml", None, "none.toml"),
        (text.replace("neurons", "neuron"), None, "did you mean `neurons`"),
        (text + "\n[", None, "<config>"),
        (smoke, {"training.nonsense": 1}, "nonsense"),
        (smoke, {"seed": -1}, "seed"),
        (smoke, {"seed": float("nan")}, "seed"),
        (smoke, {"seed": object()}, "seed: <object"),
        (smoke.parent / "rk4-only.toml", None, "no section"),
    ]:
        with pytest.raises(pinc.InputError, match=message):
            pinc.train(config, overrides)
    # A text with all that TOML escapes comes to the program as it is.
    with pytest.raises(pinc.InputError, match=r'"a \\"b\\" given|"a \\"b'):
        pinc.train(smoke, {"name": 'a "b"'})
    with pytest.raises(TypeError):
        pinc.train(3)  # type: ignore[arg-type]
