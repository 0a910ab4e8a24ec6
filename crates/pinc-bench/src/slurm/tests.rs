//! Scripts for Slurm: what they ask for, and where they run.

use super::*;

/// A sweep of six trials with these values for Slurm.
fn experiment(slurm: &str) -> Experiment {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/smoke/rk4-only.toml");
    let sweep = "sweep.grid=[{ key = \"control.n2\", values = [5, 6, 7, 8, 9, 10] }]";
    let sets = [sweep.to_owned(), format!("sweep.slurm={{ {slurm} }}")];
    Experiment::load(path.as_ref(), &sets, &Plants::built_in()).unwrap()
}

fn options(options: &[&str]) -> OnSlurm {
    let options = options.iter().map(|&option| option.to_owned()).collect();
    OnSlurm { options, dry_run: true, ..OnSlurm::default() }
}

/// What the two scripts of a submission ask for, and how many jobs there are.
fn asked(slurm: &str, on: &OnSlurm) -> (Vec<String>, Vec<String>, usize) {
    let dir = tempfile::tempdir().unwrap();
    let submitted = submit(&experiment(slurm), dir.path(), on).unwrap();
    let lines = |name: &str| -> Vec<String> {
        let text = fs::read_to_string(submitted.folder.join(name)).unwrap();
        let own = text.lines().filter_map(|line| line.strip_prefix("#SBATCH --"));
        own.map(str::to_owned).collect()
    };
    (lines("work.sh"), lines("merge.sh"), submitted.jobs)
}

/// The command's options go over those of the config; the work has one core unless it is given
/// more, and the merge asks for none of its own.
#[test]
fn options_of_the_command_go_over_those_of_the_config() {
    let (work, merge, jobs) = asked("partition = \"long\", time = 60", &options(&["time=5"]));
    assert_eq!(jobs, 6, "one per trial");
    let asks = ["cpus-per-task=1", "partition=long", "time=5"];
    assert_eq!(work[work.len() - 3..], asks);
    assert!(work.contains(&"array=1-6".to_owned()), "{work:?}");
    assert_eq!(merge[merge.len() - 2..], asks[1..]);
    let (work, merge, _) = asked("cpus-per-task = 4", &options(&[]));
    for lines in [work, merge] {
        let threads = lines.iter().filter(|line| line.starts_with("cpus-per-task"));
        assert_eq!(threads.collect::<Vec<_>>(), ["cpus-per-task=4"], "{lines:?}");
    }
}

/// The command's number of jobs counts, then the config's, then 16; there are no more than there is
/// work.
#[test]
fn there_are_as_many_jobs_as_asked_for_and_no_more_than_work() {
    let with = |jobs| OnSlurm { jobs, ..options(&[]) };
    assert_eq!(asked("jobs = 4", &with(None)).2, 4);
    assert_eq!(asked("jobs = 4", &with(Some(3))).2, 3);
    assert_eq!(asked("jobs = 3", &with(Some(5))).2, 5);
    assert_eq!(asked("jobs = 4", &with(Some(100))).2, 6);
    assert_eq!(asked("", &with(None)).2, 6);
    assert_eq!(asked("", &options(&["jobs=2"])).2, 2);
}

/// A directory's name with a quote and a space is one word for the shell.
#[test]
fn places_are_quoted() {
    let dir = tempfile::tempdir().unwrap();
    let place = dir.path().join("the plant's $HOME");
    let slurm = "modules = [\"gcc/12\", \"rust\"], jobs = 2";
    let submitted = submit(&experiment(slurm), &place, &options(&[])).unwrap();
    let script = fs::read_to_string(submitted.folder.join("work.sh")).unwrap();
    let quoted = format!("--out '{}/the plant'\\''s $HOME' --shared", dir.path().display());
    assert!(script.contains(&quoted), "{script}");
    assert!(script.contains("module load gcc/12 rust\n"), "{script}");
    assert!(script.ends_with("--shard \"$share/2\"\n"), "{script}");
    assert!(!script.contains("{name}") && !script.contains("{dir}"), "{script}");
    let said = submitted.to_string();
    assert!(said.contains("work.sh: one of 2 jobs\n"), "{said}");
}

/// An option that cannot be one is refused by name.
#[test]
fn an_option_that_slurm_does_not_have_is_refused() {
    let refused = |option: &str| {
        let dir = tempfile::tempdir().unwrap();
        submit(&experiment(""), dir.path(), &options(&[option])).unwrap_err().to_string()
    };
    for (option, said) in [
        ("partition", "--slurm partition: no `=` given, expected key=value"),
        ("jobs=0", "--slurm jobs=0: \"0\" given, expected a number from 1 to 10000"),
        ("array=1-3", "--slurm array=1-3: \"1-3\" given, expected another option"),
    ] {
        assert!(refused(option).starts_with(said), "{}", refused(option));
    }
}

/// What is submitted is said by its numbers, and where its progress is.
#[test]
fn a_submission_says_what_it_did() {
    let submitted = |jobs: usize, numbers: &[&str]| {
        let numbers = numbers.iter().map(|&number| number.to_owned()).collect();
        Submitted { folder: PathBuf::from("runs/a/slurm"), jobs, numbers }.to_string()
    };
    assert_eq!(submitted(0, &[]), "all trials are over: there is nothing to submit");
    assert_eq!(
        submitted(3, &["17", "18"]),
        "submitted: 17, 18 (3 jobs, and the merge after them); `pinc status runs/a` shows their \
         progress"
    );
}
