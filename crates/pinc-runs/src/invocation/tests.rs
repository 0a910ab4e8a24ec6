//! Dates of calls.

use super::*;
use std::time::Duration;

#[test]
fn dates() {
    // From `date -u -d @N --rfc-3339=seconds`.
    for (seconds, expected) in [
        (0, "1970-01-01T00:00:00Z"),
        (951_782_400, "2000-02-29T00:00:00Z"),
        (1_709_251_199, "2024-02-29T23:59:59Z"),
        (1_767_225_600, "2026-01-01T00:00:00Z"),
        (4_107_542_399, "2100-02-28T23:59:59Z"),
    ] {
        assert_eq!(rfc3339(UNIX_EPOCH + Duration::from_secs(seconds)), expected);
    }
}

#[test]
fn paths_are_cut_down() {
    assert_eq!(without_places("configs/a.toml"), "configs/a.toml");
    assert_eq!(without_places("/somewhere/private/a.toml"), ".../a.toml");
    assert_eq!(without_places("--out=/somewhere/private/run"), "--out=.../run");
    assert_eq!(without_places("../../private/run"), ".../run");
    assert_eq!(without_places("training.lambda=1.0"), "training.lambda=1.0");
    let below = std::env::current_dir().unwrap().join("runs").join("a");
    assert_eq!(without_places(&below.to_string_lossy()), "runs/a");
    let beside = std::env::current_dir().unwrap().join("../private/a.toml");
    assert_eq!(without_places(&beside.to_string_lossy()), ".../a.toml");
}
