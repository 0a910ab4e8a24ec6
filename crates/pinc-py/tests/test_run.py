"""Runs and their directories."""

import signal
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import pinc_nmpc as pinc


def test_what_is_in_a_run(done: pinc.Run) -> None:
    assert done.metrics["experiment"] == "smoke-van-der-pol"
    assert done.models == ["pinc", "rk4"]
    assert {"control-pinc", "steps-rk4", "training", "prediction"} <= set(done.tables)
    assert 'preset = "ours"' in done.config and "version" in str(done.provenance)
    assert done.report.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    training = done.training
    assert training["iteration"].dtype == np.float64
    assert training["iteration"][-1] == done.metrics["training"]["iterations"]
    # Where nothing was validated the cell is empty.
    assert np.isnan(training["validation_mse"][0]) and (training["validation_mse"] > 0).any()
    trace = done.control("pinc")
    assert list(trace) == ["t", "x1", "x2", "u", "x1_ref", "x2_ref"]
    assert trace["t"][-1] == 5.0 and trace["x1"][0] == 0.5
    assert set(done.steps("rk4")["status"]) == {"converged"}
    assert done.model.states == ["x1", "x2"]


def test_tables_are_frames_too(done: pinc.Run) -> None:
    pandas = pytest.importorskip("pandas")
    frame = done.frame("steps-pinc")
    assert isinstance(frame, pandas.DataFrame)
    assert frame["status"].iloc[0] == "converged" and len(frame) == 10


def test_what_is_missing_is_named(done: pinc.Run, tmp_path: Path) -> None:
    with pytest.raises(pinc.InputError, match="no run directory"):
        pinc.Run(tmp_path)
    with pytest.raises(pinc.InputError, match="pinc, rk4; name one"):
        done.control()
    with pytest.raises(pinc.InputError, match="no closed loop with rk5, but with pinc, rk4"):
        done.steps("rk5")
    with pytest.raises(pinc.InputError, match="no such file"):
        done.estimates("rk4")


def test_a_run_without_a_net(smoke: Path, tmp_path: Path) -> None:
    run = pinc.run(smoke.parent / "rk4-only.toml", str(tmp_path / "run"))
    assert run.models == ["rk4"]
    assert len(run.control()["t"]) == 1 + 9 * len(run.steps()["step"])
    with pytest.raises(pinc.InputError, match="no such file"):
        _ = run.model


def test_ctrl_c_leaves_a_run_that_can_be_resumed(smoke: Path, tmp_path: Path) -> None:
    main = threading.main_thread().ident
    assert main is not None
    longer = {"training.phases.0.iterations": 1500}

    def interrupt() -> None:
        # What is there first.
        while not (tmp_path / "config.toml").exists():
            time.sleep(0.001)
        signal.pthread_kill(main, signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        pinc.run(smoke, tmp_path, longer)
    thread.join()
    assert not (tmp_path / "report.html").exists()
    resumed = pinc.run(smoke, tmp_path, longer, resume=True)
    assert resumed.model.to_bytes() == pinc.train(smoke, longer).model.to_bytes()


def test_what_cannot_be_run_is_refused(smoke: Path, tmp_path: Path) -> None:
    sweep = smoke.read_text(encoding="utf-8") + "\n[sweep]\nseeds = 2\n"
    with pytest.raises(pinc.InputError, match="sweep"):
        pinc.run(sweep, tmp_path)
    never = {"control.max_failed_share": 0.0, "control.state_high": [1e-3]}
    with pytest.raises(pinc.RunError, match="control steps"):
        pinc.run(smoke.parent / "rk4-only.toml", tmp_path, never)
