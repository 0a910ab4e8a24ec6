//! The times of controllers in C: exported, compiled, and run by their self-test.

use pinc_config::Experiment;
use pinc_record::{RecordError, write_atomically};
use pinc_runs::{RunError, Target, export_controller};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Times the steps of the self-test on this machine.
const TIMED: &str = include_str!("../../board/timed.c");
/// Counts the instructions of its steps on an emulated board.
const BOARD: &str = include_str!("../../board/board.c");
const LINK: &str = include_str!("../../board/link.ld");

/// The compiler of this machine, that of the board, and its emulator.
const COMPILER: &str = "cc";
const CROSS_COMPILER: &str = "arm-none-eabi-gcc";
const EMULATOR: &str = "qemu-system-arm";

/// QEMU's ticks of 40 ns for 10 instructions of 64 ns each.
const COUNT: &str = "static void report(void)\n{\n    \
     printf(\"instructions %lu\\n\", (unsigned long)(cost_of_step.ticks * 10 / 16));\n}\n";

/// The cost of a control step in C.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CostInC {
    /// The median of the self-test's steps, in us.
    pub(super) p50_us: f64,
    /// The 99th percentile of these few steps: the longest.
    pub(super) p99_us: f64,
    /// The most instructions of a step on a Cortex-M4F in single precision, where a cross compiler
    /// and an emulator are installed.
    pub(super) instructions: Option<u64>,
}

/// An exported controller and its program that measures times.
#[derive(Debug)]
pub(super) struct InC {
    dir: PathBuf,
    instructions: Option<u64>,
}

impl InC {
    /// Exports the controller of an experiment with one model, that of the file `model` if it is a
    /// net, into the directory `dir`, and compiles it.
    ///
    /// # Errors
    ///
    /// Why it cannot be exported or compiled.
    pub(super) fn new(
        experiment: &Experiment,
        model: Option<&Path>,
        dir: &Path,
    ) -> Result<Self, RunError> {
        let target = (Target::C, false);
        export_controller(experiment, model, None, target, Some("ctl"), Some(dir))?;
        let mut built = Self { dir: dir.to_owned(), instructions: None };
        built.write("timed.c", TIMED)?;
        built.write("measured.h", &built.header(""))?;
        let sources = built.sources()?;
        let renamed = format!("-D{}=timed_step", built.step());
        let options = ["-std=c99", "-O2"];
        built.compile(COMPILER, &options, &["-Dmain=selftest", &renamed, "ctl_selftest.c"])?;
        let mut link: Vec<&str> = vec!["-o", "timed", "timed.c", "ctl_selftest.o"];
        link.extend(sources.iter().map(String::as_str));
        link.push("-lm");
        built.run(Command::new(COMPILER).args(options).args(link))?;
        built.instructions = built.emulate(&sources, &renamed).ok();
        Ok(built)
    }

    /// Runs it.
    ///
    /// # Errors
    ///
    /// If the self-test fails.
    pub(super) fn time(&self) -> Result<CostInC, RunError> {
        // A relative path would be looked up in the directory in which the program is to run.
        let program = self.dir.join("timed");
        let program = fs::canonicalize(&program).map_err(RecordError::unreadable(&program))?;
        let said = self.run(&mut Command::new(program))?;
        let times = said.lines().filter_map(|line| line.strip_prefix("us ")?.parse().ok());
        let mut times: Vec<f64> = times.collect();
        times.sort_by(f64::total_cmp);
        let middle = times.get(times.len() / 2).zip(times.last());
        let (&p50_us, &p99_us) = middle
            .ok_or_else(|| RunError::Failed("the self-test in C takes no step".to_owned()))?;
        Ok(CostInC { p50_us, p99_us, instructions: self.instructions })
    }

    /// What the controller's functions begin with.
    fn kind(&self) -> &'static str {
        if self.dir.join("ctl_feedback.c").exists() { "ctl_feedback" } else { "ctl_mpc" }
    }

    fn step(&self) -> String {
        format!("{}_step", self.kind())
    }

    /// The declarations by which a measuring program stands between the self-test and the step.
    fn header(&self, more: &str) -> String {
        let kind = self.kind();
        format!(
            "#include \"{kind}.h\"\n#define STATUS ctl_status\n\
             #define STEP ctl_status timed_step({kind} *of, const CTL_REAL *x, const CTL_REAL *r, CTL_REAL *u)\n\
             #define CALL {kind}_step(of, x, r, u)\nSTEP;\n{more}"
        )
    }

    fn write(&self, name: &str, text: &str) -> Result<(), RunError> {
        Ok(write_atomically(&self.dir.join(name), text.as_bytes())?)
    }

    /// The C files of the controller itself.
    fn sources(&self) -> Result<Vec<String>, RunError> {
        let entries = fs::read_dir(&self.dir).map_err(RecordError::unreadable(&self.dir))?;
        let names = entries.flatten().filter_map(|entry| entry.file_name().into_string().ok());
        let own = names.filter(|name| {
            let is_source = name.starts_with("ctl_") && name.ends_with(".c");
            is_source && name != "ctl_selftest.c"
        });
        let mut own: Vec<String> = own.collect();
        own.sort();
        Ok(own)
    }

    fn compile(&self, compiler: &str, options: &[&str], more: &[&str]) -> Result<(), RunError> {
        self.run(Command::new(compiler).args(options).arg("-c").args(more)).map(drop)
    }

    /// What a command in the directory writes; it has to succeed.
    fn run(&self, command: &mut Command) -> Result<String, RunError> {
        let program = command.get_program().display().to_string();
        let done = command.current_dir(&self.dir).output();
        let done = done.map_err(|error| RunError::Failed(format!("{program}: {error}")))?;
        if done.status.success() {
            return Ok(String::from_utf8_lossy(&done.stdout).into_owned());
        }
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        Err(RunError::Failed(format!("{program}: {}: {said}", done.status)))
    }

    /// The most instructions of a step on the emulated board.
    fn emulate(&self, sources: &[String], renamed: &str) -> Result<u64, RunError> {
        let step = "static cost cost_of_step = {\"step\", 0, 0, 0};\nSTEP\n{\n    STATUS status;\n    \
                    MEASURE(cost_of_step, status = CALL);\n    return status;\n}\n";
        self.write("measured.h", &self.header(&[step, COUNT].concat()))?;
        self.write("board.c", BOARD)?;
        self.write("link.ld", LINK)?;
        let options = [
            "-mcpu=cortex-m4",
            "-mthumb",
            "-mfpu=fpv4-sp-d16",
            "-mfloat-abi=hard",
            "-O2",
            "-DCTL_REAL=float",
        ];
        let selftest = ["-std=c99", renamed, "ctl_selftest.c", "-o", "ctl_selftest.board.o"];
        self.compile(CROSS_COMPILER, &options, &selftest)?;
        let libraries = ["--specs=rdimon.specs", "-nostartfiles", "-Tlink.ld", "-lm", "-lc"];
        let mut link = Command::new(CROSS_COMPILER);
        link.args(options)
            .arg("-std=gnu99")
            .args(["board.c", "ctl_selftest.board.o"])
            .args(sources);
        link.args(libraries).args(["-lrdimon", "-lgcc", "-o", "board.elf"]);
        self.run(&mut link)?;
        let said = self.run(Command::new(EMULATOR).args([
            "-M",
            "mps2-an386",
            "-nographic",
            "-semihosting",
            "-icount",
            "shift=6",
            "-kernel",
            "board.elf",
        ]))?;
        let count = said.lines().find_map(|line| line.strip_prefix("instructions ")?.parse().ok());
        count.ok_or_else(|| RunError::Failed(format!("{EMULATOR} counts no instructions")))
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    /// A directory with a program in place of the compiled self-test, which prints this.
    fn printing(lines: &str) -> (tempfile::TempDir, InC) {
        let dir = tempfile::tempdir().unwrap();
        // Written by a process of its own: no other test holds the file open when it begins.
        let write = "printf '#!/bin/sh\nprintf \"%s\"\n' \"$0\" > timed && chmod +x timed";
        let mut shell = Command::new("sh");
        let status = shell.args(["-c", write, lines]).current_dir(dir.path()).status().unwrap();
        assert!(status.success());
        let built = InC { dir: dir.path().to_owned(), instructions: Some(7) };
        (dir, built)
    }

    /// The self-test says the time of each of its steps: the middle one and the longest count, in
    /// the order of numbers, not of texts.
    #[test]
    fn the_cost_is_the_median_and_the_longest_time() {
        let (_dir, built) = printing("us 9\\nsteps 5\\nus 100\\nus 1.5\\nus 20\\nus 3\\n");
        let cost = built.time().unwrap();
        let expected = CostInC { p50_us: 9.0, p99_us: 100.0, instructions: Some(7) };
        assert_eq!(cost, expected);
        let (_dir, built) = printing("steps 0\\n");
        let said = built.time().unwrap_err().to_string();
        assert_eq!(said, "the self-test in C takes no step");
    }

    /// A controller is one with a plan or a feedback; its own sources are compiled beside the
    /// self-test, in the same order on each machine.
    #[test]
    fn sources_are_those_of_the_controller() {
        let dir = tempfile::tempdir().unwrap();
        let built = InC { dir: dir.path().to_owned(), instructions: None };
        for name in ["ctl_mpc.c", "ctl_mpc.h", "ctl_selftest.c", "ctl_equation.c", "timed.c"] {
            built.write(name, "").unwrap();
        }
        assert_eq!(built.sources().unwrap(), ["ctl_equation.c", "ctl_mpc.c"]);
        assert_eq!(built.step(), "ctl_mpc_step");
        assert!(
            built
                .header("MORE\n")
                .ends_with("#define CALL ctl_mpc_step(of, x, r, u)\nSTEP;\nMORE\n")
        );
        built.write("ctl_feedback.c", "").unwrap();
        assert_eq!(built.step(), "ctl_feedback_step");
        let missing = InC { dir: dir.path().join("nowhere"), instructions: None };
        assert!(missing.time().unwrap_err().to_string().contains("nowhere"));
    }
}
