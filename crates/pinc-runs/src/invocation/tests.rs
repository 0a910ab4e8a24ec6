//! Paths of calls.

use super::*;

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
