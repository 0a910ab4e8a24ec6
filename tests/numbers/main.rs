//! The numbers of the docs against the commands that give them.
//!
//! Without arguments, as part of all tests: each number names a command. With a path to the program
//! the commands are run, and what they give is compared with what the docs print:
//!
//! ```sh
//! cargo test -p pinc-tests --test numbers -- target/release/pinc [--quick | --long] [--write] [TEXT]
//! ```
//!
//! The tool then changes each number that was compared and looks whether that would be noticed.
//! docs/testing.md explains the comments that it reads.

use claim::{Claim, Effort, Fault, claims};
use page::Page;
use pinc_tests::book;
use source::{Found, Runner};
use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

mod claim;
mod numeral;
mod page;
mod source;

/// The pages whose numbers are compared.
const PAGES: [&str; 8] = [
    "README.md",
    "docs/first-run.md",
    "docs/known-error.md",
    "docs/measurements.md",
    "docs/findings.md",
    "docs/results.md",
    "docs/accuracy-cost.md",
    "docs/tune.md",
];

fn main() -> ExitCode {
    numeral::check_itself();
    match Options::read().and_then(|options| options.check()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(problem) => {
            say(&problem);
            ExitCode::FAILURE
        }
    }
}

/// Prints a line.
fn say(line: &str) {
    // Failing to print is harmless.
    let _ = writeln!(std::io::stdout(), "{line}");
}

/// What was asked for.
struct Options {
    root: PathBuf,
    /// The program; without one no command is run.
    pinc: Option<PathBuf>,
    effort: Effort,
    /// Whether numbers that differ are written into the pages.
    writes: bool,
    /// Commands with this text alone are run.
    only: Option<String>,
}

impl Options {
    fn read() -> Result<Self, String> {
        let root = book::root();
        let mut options =
            Self { root, pinc: None, effort: Effort::Full, writes: false, only: None };
        let mut unknown = None;
        for argument in std::env::args().skip(1) {
            match argument.as_str() {
                "--quick" => options.effort = Effort::Quick,
                "--long" => options.effort = Effort::Long,
                "--write" => options.writes = true,
                path if options.pinc.is_none() && Path::new(path).is_file() => {
                    options.pinc = Some(path.into())
                }
                other if other.starts_with("--") => unknown = Some(other.to_owned()),
                text => options.only = Some(text.to_owned()),
            }
        }
        match (unknown, &options.pinc) {
            (Some(unknown), Some(_)) => Err(format!("`{unknown}` is no option")),
            // Options and filters of other tests come this way too.
            (None | Some(_), None) => Ok(Self { only: None, ..options }),
            (None, Some(_)) => Ok(options),
        }
    }

    fn pages(&self) -> Result<Vec<Page>, String> {
        let page = |path: &&str| Page::new(path, book::page(&self.root.join(path))?);
        PAGES.iter().map(page).collect()
    }

    /// Whether the claim's command is to be run.
    fn takes(&self, claim: &Claim) -> bool {
        claim.effort <= self.effort
            && self.only.as_ref().is_none_or(|text| claim.command.contains(text))
    }

    /// Whether all numbers are right.
    fn check(&self) -> Result<bool, String> {
        let pages = self.pages()?;
        let (mut wrong, mut left) = (0, BTreeSet::new());
        let mut all = Vec::new();
        for page in &pages {
            let (claims, faults) = claims(page, &pages);
            wrong += faults.len();
            tell(page, &faults);
            all.push(claims);
        }
        let Some(pinc) = &self.pinc else {
            let count: usize = all.iter().map(Vec::len).sum();
            say(&format!("{count} numbers with commands, {wrong} without"));
            return Ok(wrong == 0);
        };
        let checker =
            Checker { runner: Runner::new(&self.root, pinc)?, rounds_alike: rounds_alike() };
        let (mut held, mut unnoticed) = (0, 0);
        for (page, claims) in pages.iter().zip(&all) {
            left.extend(claims.iter().filter(|of| !self.takes(of)).map(|of| of.command.clone()));
            let taken: Vec<Claim> = claims.iter().filter(|of| self.takes(of)).cloned().collect();
            let faults: Vec<Fault> =
                taken.iter().filter_map(|of| checker.told_fault(page, of)).collect();
            if self.writes {
                let text = checker.corrected(page, &taken);
                book::write(&self.root.join(&page.path), &text)?;
            }
            wrong += faults.len();
            held += taken.len() - faults.len();
            let missed = checker.unnoticed(page, &pages, &taken)?;
            unnoticed += missed.len();
            tell(page, &missed);
        }
        for command in left.iter().filter(|_| self.only.is_none()) {
            say(&format!("not run: {command}"));
        }
        say(&format!(
            "{held} numbers are what their commands give, {wrong} are not; of those that are, {unnoticed} could \
             be changed without being noticed"
        ));
        Ok(wrong == 0 && unnoticed == 0)
    }
}

fn tell(page: &Page, faults: &[Fault]) {
    for fault in faults {
        say(&format!("{}: {}", page.place(fault.at), fault.what));
    }
}

/// Whether nets come out of trainings here bit for bit as where the docs were made: the kernels round
/// by the width of the processor's vectors.
fn rounds_alike() -> bool {
    #[cfg(target_arch = "x86_64")]
    {
        std::is_x86_feature_detected!("avx512f")
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        false
    }
}

/// Compares claims with what their commands give.
struct Checker {
    runner: Runner,
    rounds_alike: bool,
}

impl Checker {
    /// What is wrong with a claim, said at once: all commands together take an hour.
    fn told_fault(&self, page: &Page, claim: &Claim) -> Option<Fault> {
        self.fault(page, claim).inspect(|fault| tell(page, std::slice::from_ref(fault)))
    }

    /// What is wrong with a claim.
    fn fault(&self, page: &Page, claim: &Claim) -> Option<Fault> {
        let fault = |what| Some(Fault { at: claim.span.start, what });
        let shown = &page.text[claim.span.clone()];
        let by = format!("by `{}` ({})", claim.command, claim.source);
        match (self.runner.value(claim), &claim.numeral) {
            (Err(problem), _) => fault(problem),
            (Ok(Found::Number(value)), Some(printed)) => {
                let holds = claim.rule.holds(printed, value, self.rounds_alike);
                let written = printed.written(value, &self.line(printed, shown));
                if holds { None } else { fault(format!("{shown} should be {written} {by}")) }
            }
            (Ok(Found::Number(value)), None) => fault(format!("{shown} should be {value} {by}")),
            (Ok(Found::Text(text)), _) if text == shown => None,
            (Ok(Found::Text(text)), _) => fault(format!("{shown} should be {text} {by}")),
        }
    }

    /// The text that a numeral's way of writing is taken from: its own, at its own place.
    fn line(&self, numeral: &numeral::Numeral, shown: &str) -> String {
        format!("{}{shown}", " ".repeat(numeral.span.start))
    }

    /// The page with what the commands give.
    fn corrected(&self, page: &Page, claims: &[Claim]) -> String {
        let mut text = page.text.clone();
        let mut sorted: Vec<&Claim> =
            claims.iter().filter(|of| self.fault(page, of).is_some()).collect();
        sorted.sort_by_key(|of| std::cmp::Reverse(of.span.start));
        for claim in sorted {
            let written = match (self.runner.value(claim), &claim.numeral) {
                (Ok(Found::Number(value)), Some(printed)) => {
                    printed.written(value, &self.line(printed, &page.text[claim.span.clone()]))
                }
                (Ok(Found::Text(text)), _) => text,
                (Ok(Found::Number(_)) | Err(_), _) => continue,
            };
            text.replace_range(claim.span.clone(), &written);
        }
        text
    }

    /// Claims that hold and would seem to hold if the page said something else.
    fn unnoticed(
        &self,
        page: &Page,
        pages: &[Page],
        claims: &[Claim],
    ) -> Result<Vec<Fault>, String> {
        let mut missed = Vec::new();
        for claim in claims.iter().filter(|of| self.fault(page, of).is_none()) {
            let other = match (self.runner.value(claim), &claim.numeral) {
                (Ok(Found::Number(value)), Some(printed)) => {
                    let wrong = claim.rule.wrong(printed, value, self.rounds_alike);
                    printed.written(wrong, &self.line(printed, &page.text[claim.span.clone()]))
                }
                _ => "another text".to_owned(),
            };
            let mut text = page.text.clone();
            text.replace_range(claim.span.clone(), &other);
            let changed = Page::new(&page.path, text)?;
            let (after, _) = self::claims(&changed, pages);
            let same = |of: &&Claim| of.span.start == claim.span.start;
            let is_noticed =
                after.iter().find(same).is_none_or(|of| self.fault(&changed, of).is_some());
            if !is_noticed {
                let what = format!("{} could be {other}", &page.text[claim.span.clone()]);
                missed.push(Fault { at: claim.span.start, what });
            }
        }
        Ok(missed)
    }
}
