//! `[sweep.slurm]`.

use pinc_config::{Problem, SlurmSpec};

fn of(text: &str) -> Result<SlurmSpec, (String, Problem)> {
    SlurmSpec::of(&text.parse().unwrap())
}

#[test]
fn only_options_of_sbatch_get_into_a_script() {
    let spec = of("jobs = 8\npartition = \"short\"\ntime = \"02:00:00\"\ncpus-per-task = 4\n\
                   modules = [\"gcc/12\", \"openmpi\"]")
    .unwrap();
    assert_eq!(spec.jobs, Some(8));
    assert_eq!(spec.modules, ["gcc/12", "openmpi"]);
    let options: Vec<_> = spec.options.iter().map(|(k, v)| format!("{k}={v}")).collect();
    assert_eq!(options, ["cpus-per-task=4", "partition=short", "time=02:00:00"]);
    for (text, key) in [
        ("jobs = 0", "jobs"),
        ("array = \"1-9\"", "array"),
        ("partition = \"a\\nrm\"", "partition"),
        ("partition = \"$(rm)\"", "partition"),
        ("\"a b\" = 1", "a b"),
        ("modules = [\"a;b\"]", "modules"),
        ("exclusive = true", "exclusive"),
    ] {
        assert_eq!(of(text).unwrap_err().0, key, "{text}");
    }
    assert_eq!(of("modules = \"a,b\"").unwrap().modules, ["a", "b"]);
}
