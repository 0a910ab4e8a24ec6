//! Generated files, compiled by the C compiler of the machine.

use pinc_export::GeneratedFile;
use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};
use tempfile::TempDir;

/// What generated C must be clean under.
const STRICT: [&str; 9] = [
    "-std=c99",
    "-Wall",
    "-Wextra",
    "-Wconversion",
    "-Wdouble-promotion",
    "-Wvla",
    "-pedantic",
    "-Werror",
    "-fno-stack-protector",
];

/// What libm and the compiler itself bring along.
const KNOWN: [&str; 28] = [
    "tanh",
    "sqrt",
    "exp",
    "log",
    "sin",
    "cos",
    "tan",
    "atan",
    "pow",
    "fabs",
    "fmax",
    "fmin",
    "hypot",
    "tanhf",
    "sqrtf",
    "expf",
    "logf",
    "sinf",
    "cosf",
    "tanf",
    "atanf",
    "powf",
    "fabsf",
    "hypotf",
    "memcpy",
    "memset",
    "memmove",
    "_GLOBAL_OFFSET_TABLE_",
];

/// For drivers of controllers `ctl`: reads numbers; 0 at the end of the input.
pub(crate) const READ: &str = r#"
static int read(CTL_REAL *to, int count)
{
    int i;
    for (i = 0; i < count; i++) {
        double v;
        if (scanf("%lf", &v) != 1) {
            return 0;
        }
        to[i] = (CTL_REAL)v;
    }
    return 1;
}
"#;

/// Generated files in a directory.
pub(crate) struct Sources {
    dir: TempDir,
    /// The C files, without those that have a `main`.
    library: Vec<String>,
}

impl Sources {
    pub(crate) fn new(files: &[GeneratedFile]) -> Self {
        let dir = tempfile::tempdir().unwrap();
        for file in files {
            let path = dir.path().join(&file.path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, &file.bytes).unwrap();
        }
        let names = files.iter().map(|file| file.path.clone());
        let library =
            names.filter(|name| name.ends_with(".c") && !name.ends_with("_selftest.c")).collect();
        Self { dir, library }
    }

    /// Files of which the driver includes what it needs.
    pub(crate) fn included(files: &[GeneratedFile]) -> Self {
        Self { library: Vec::new(), ..Self::new(files) }
    }

    /// Files of which the driver includes one, and the others are compiled by themselves.
    pub(crate) fn with_included(files: &[GeneratedFile], included: &str) -> Self {
        let mut all = Self::new(files);
        all.library.retain(|name| name != included);
        all
    }

    /// Builds the library and the self-test by the Makefile, and runs it.
    #[track_caller]
    pub(crate) fn make_test(&self) {
        self.run(Command::new("make").args(["-s", "test"]));
    }

    fn path(&self) -> &Path {
        self.dir.path()
    }

    /// Runs a command in the directory; it has to succeed and say nothing on standard error.
    #[track_caller]
    fn run(&self, command: &mut Command) -> String {
        let output = command.current_dir(self.path()).output().unwrap();
        let errors = String::from_utf8_lossy(&output.stderr);
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success() && errors.is_empty(), "{command:?}: {errors}{text}");
        text
    }

    /// The program of the generated files and `main`, compiled at an optimization `level` with `more`
    /// options.
    #[track_caller]
    fn program(&self, main: &str, level: &str, more: &[&str], as_program: &str) {
        let mut command = Command::new("cc");
        command.args(STRICT).args([level, "-I."]).args(more).args(&self.library).arg(main);
        self.run(command.args(["-lm", "-o", as_program]));
    }

    /// The self-test passes, compiled with `more` options.
    #[track_caller]
    pub(crate) fn selftest(&self, name: &str, more: &[&str]) -> String {
        self.program(&format!("{name}_selftest.c"), "-O1", more, "selftest");
        self.run(&mut Command::new("./selftest"))
    }

    /// What a program of the generated files and the text `main` writes when it is given `input`.
    /// Not optimized: compiling is what takes the time.
    #[track_caller]
    pub(crate) fn drive(&self, main: &str, more: &[&str], input: &[f64]) -> Vec<f64> {
        fs::write(self.path().join("drive.c"), main).unwrap();
        self.program("drive.c", "-O0", more, "drive");
        let mut command = Command::new(self.path().join("drive"));
        let mut child =
            command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("a program");
        let text: String = input.iter().map(|v| format!("{v:?}\n")).collect();
        let mut stdin = child.stdin.take().unwrap();
        let writer = std::thread::spawn(move || stdin.write_all(text.as_bytes()));
        let output = child.wait_with_output().unwrap();
        writer.join().unwrap().unwrap();
        assert!(output.status.success(), "{:?}", output.status);
        let text = String::from_utf8(output.stdout).unwrap();
        text.split_whitespace().map(|word| word.parse().unwrap()).collect()
    }

    /// Every file compiles.
    #[track_caller]
    pub(crate) fn assert_compiles(&self) {
        for source in &self.library {
            let object = ["-O1", "-I.", "-c", "-o", "object.o"];
            self.run(Command::new("cc").args(STRICT).args(object).arg(source));
        }
    }

    /// Clean as C under other compilers and as C++, where the machine has these; it needs libm
    /// only; and the self-test, optimized as users have it, passes in `double`. Gives what it says.
    #[track_caller]
    pub(crate) fn assert_portable(&self, name: &str) -> String {
        for number in ["double", "float"] {
            let prefix = name.to_uppercase();
            let real = format!("-D{prefix}_REAL={number}");
            let whole_code = [real.as_str(), &format!("-D{prefix}_SENSITIVITY")];
            let selftest = format!("{name}_selftest.c");
            let mut objects = Vec::new();
            for source in self.library.iter().chain([&selftest]) {
                let object = format!("{source}.o");
                let whole = ["-O2", "-I.", &real, "-c", source, "-o", &object];
                self.run(Command::new("cc").args(STRICT).args(whole));
                if *source != selftest {
                    self.assert_self_contained(name, &object);
                }
                self.assert_clean_elsewhere(source, whole_code);
                objects.push(object);
            }
            let program = format!("selftest-{number}");
            self.run(Command::new("cc").args(objects).args(["-lm", "-o", &program]));
        }
        self.run(&mut Command::new("./selftest-double"))
    }

    /// The self-test of code that has been found portable passes in `float`.
    #[track_caller]
    pub(crate) fn selftest_in_float(&self) {
        self.run(&mut Command::new("./selftest-float"));
    }

    /// Clean as C for clang and as C++, where the machine has these.
    #[track_caller]
    fn assert_clean_elsewhere(&self, source: &str, [real, more]: [&str; 2]) {
        let has = |program: &str| {
            let found = Command::new(program).arg("--version").stdout(Stdio::null()).status();
            found.is_ok_and(|status| status.success())
        };
        let options = ["-fsyntax-only", "-I.", real, more];
        if has("clang") {
            self.run(Command::new("clang").args(options).args(STRICT).arg(source));
        }
        if has("c++") {
            let flags = &STRICT[1..];
            self.run(Command::new("c++").args(options).args(["-x", "c++"]).args(flags).arg(source));
        }
    }

    /// The object file needs only libm and what is generated with it.
    #[track_caller]
    fn assert_self_contained(&self, name: &str, object: &str) {
        let undefined = self.run(Command::new("nm").args(["-u", object]));
        for symbol in undefined.split_whitespace().filter(|word| *word != "U") {
            let own = symbol.starts_with(&format!("{name}_"));
            assert!(own || KNOWN.contains(&symbol), "undefined: {symbol}");
        }
    }
}
