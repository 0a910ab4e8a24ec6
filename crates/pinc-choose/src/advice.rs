//! The advice, as a table and a sentence.

use crate::candidate::{Candidate, LONGER};
use crate::judge::{AS_CHEAP, Score, Standard, Tried};
use crate::search::{Search, SearchResult};
use pinc_net::TrainingTarget;
use pinc_record::decimals;
use std::fmt;

/// A step that is wrong by more than this, in widths of the domain, is worth a word.
const LARGE: f64 = 0.1;

/// The model to use, and why. Its `Display` is a table of all models tried, and the reasons.
#[derive(Clone, Debug)]
pub struct Advice<'a> {
    tried: &'a [Tried],
    standard: Standard,
    winner: &'a Tried,
    score: &'a Score,
    /// What could not be tried, and why.
    notes: &'a [String],
    within: f64,
    is_out_of_time: bool,
    untried: &'a [String],
}

impl fmt::Display for Advice<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let instructions = if self.counts() { "  M4F instr." } else { "" };
        writeln!(
            f,
            "model                          IAE  step p50 us      p99 us{instructions}  error found      \
             proven  training s"
        )?;
        let score = |tried: &&Tried| tried.result.as_ref().map_or(f64::INFINITY, |s| s.p50_us);
        let mut rows: Vec<&Tried> = self.tried.iter().collect();
        rows.sort_by(|a, b| score(a).total_cmp(&score(b)));
        for tried in rows {
            let name = tried.candidate.to_string();
            match &tried.result {
                Ok(score) => self.row(f, &name, score)?,
                Err(error) => writeln!(f, "{name:<21}   {error}")?,
            }
        }
        for sentence in self.sentences() {
            writeln!(f, "{sentence}")?;
        }
        Ok(())
    }
}

impl<'a> Advice<'a> {
    /// The advice that a search comes to; `notes` say what could not be tried. Nothing if no loop
    /// stands.
    #[must_use]
    pub fn of(search: &Search<'_>, found: &'a SearchResult, notes: &'a [String]) -> Option<Self> {
        let standard = search.standard(&found.tried)?;
        let (winner, score) = standard.winner(&found.tried)?;
        let (within, is_out_of_time) = (search.within, found.is_out_of_time);
        let (tried, untried) = (&found.tried[..], &found.untried[..]);
        Some(Self { tried, standard, winner, score, notes, within, is_out_of_time, untried })
    }

    /// The model to use.
    #[must_use]
    pub fn winner(&self) -> &'a Tried {
        self.winner
    }

    /// Whether instructions were counted of a model.
    fn counts(&self) -> bool {
        let of = |tried: &Tried| tried.result.as_ref().ok()?.instructions;
        self.tried.iter().any(|tried| of(tried).is_some())
    }

    fn row(&self, f: &mut fmt::Formatter<'_>, name: &str, score: &Score) -> fmt::Result {
        let number = |value: Option<f64>| match value {
            Some(value) if value.is_finite() => format!("{value:.1e}"),
            Some(_) => "not finite".to_owned(),
            None => "-".to_owned(),
        };
        let training = score.training_s.map_or("-".to_owned(), |s| format!("{s:.1}"));
        let instructions = match score.instructions {
            Some(count) => format!(" {count:>11}"),
            None if self.counts() => format!(" {:>11}", "-"),
            None => String::new(),
        };
        let remark = match self.standard.shortfall(score) {
            Some(shortfall) => shortfall,
            None if !self.standard.is_in_time(score) => "late".to_owned(),
            None => "good".to_owned(),
        };
        writeln!(
            f,
            "{name:<21} {:>12} {:>12.2} {:>11.2}{instructions} {:>12} {:>11} {training:>11}   {remark}",
            decimals(score.iae, 6),
            score.p50_us,
            score.p99_us,
            number(score.worst),
            number(score.proven),
        )
    }

    /// The advice, and what it does not rest on.
    pub(crate) fn sentences(&self) -> Vec<String> {
        let mut sentences = vec![self.advice()];
        if let Some(proven) = self.score.proven {
            sentences.push(format!(
                "One step of it is proven to be wrong by at most {proven:.1e} of the widths of the box \
                 where the loop may go."
            ));
        }
        if let Some(worst) = self.score.worst.filter(|worst| !(..=LARGE).contains(worst)) {
            sentences.push(format!(
                "Somewhere in the domain a step of it is wrong by {}: the loop does not go there.",
                if worst.is_finite() {
                    format!("{worst:.1} of its width")
                } else {
                    "all bounds".to_owned()
                }
            ));
        }
        if self.is_out_of_time {
            sentences.push(
                "The time ran out before all were tried: continue with --resume and a larger --budget-s."
                    .to_owned(),
            );
        }
        let is_unsound = |of: &&Tried| of.result.as_ref().is_ok_and(|s| s.unsound.is_some());
        let unsound: Vec<_> =
            self.tried.iter().filter(is_unsound).map(|of| of.candidate.to_string()).collect();
        if !unsound.is_empty() {
            sentences.push(format!(
                "Rejected whatever its loop does: {}. An integrator has to be sound in the whole box \
                 where the loop may go: stable at all random points, and with an rms error of one \
                 step of 1 % of its widths at most (pinc check looks at the same).",
                unsound.join(", ")
            ));
        }
        if !self.untried.is_empty() {
            sentences.push(format!("Not tried: {}.", self.untried.join("; ")));
        }
        sentences.extend(self.notes.iter().map(|note| format!("Note: {note}.")));
        sentences
    }

    /// How many nets, or other models, were tried.
    fn count(&self, nets: bool) -> usize {
        self.tried.iter().filter(|of| of.candidate.is_net() == nets).count()
    }

    fn advice(&self) -> String {
        let score = self.score;
        let (exact, iae) = (self.standard.exact, self.standard.iae);
        let mut text = format!(
            "Use {}: its IAE of {} is {}the IAE of the most exact model, {exact}, {}, and its \
             control step takes {:.1} us (99th percentile {:.1} us)",
            described(self.winner),
            decimals(score.iae, 6),
            match score.iae / iae - 1.0 {
                more if more.abs() < 1e-9 => String::new(),
                more if more < -self.within => "below ".to_owned(),
                _ => format!("within {} % of ", 100.0 * self.within),
            },
            decimals(iae, 6),
            score.p50_us,
            score.p99_us
        );
        let wants_net = !self.winner.candidate.is_net();
        let other = self
            .standard
            .ranking(self.tried)
            .into_iter()
            .find(|(tried, _)| tried.candidate.is_net() == wants_net);
        let what = if wants_net { "net" } else { exact.noun() };
        text += &match other {
            Some((tried, other)) if tried.candidate == Candidate::BlackBox => {
                format!("; the black box itself takes {:.1} us.", other.p50_us)
            }
            Some((tried, other)) => format!(
                "; the cheapest {what} as good, {}, takes {:.1} us.",
                tried.candidate, other.p50_us
            ),
            None => match self.count(wants_net) {
                0 => format!("; no {what} was tried."),
                count => format!("; no {what} is as good, of {count} that were tried."),
            },
        };
        let cheapest = self.standard.ranking(self.tried).into_iter().next();
        if let Some((cheapest, of)) =
            cheapest.filter(|(of, _)| of.candidate != self.winner.candidate)
        {
            text += &format!(
                " The cheapest good model, {}, takes {:.1} us: of those within {:.0} % of it, which \
                 a measurement does not tell apart, an integrator is preferred, and the most exact.",
                cheapest.candidate,
                of.p50_us,
                100.0 * (AS_CHEAP - 1.0)
            );
        }
        if let Some(budget) = self.standard.budget_us
            && !self.standard.is_in_time(score)
        {
            text += &format!(" No good model keeps within control.budget_us, {budget} us.");
        }
        text
    }
}

/// A model in words.
fn described(tried: &Tried) -> String {
    match tried.candidate {
        Candidate::Integrator { integrator, substeps } => {
            let plural = if substeps == 1 { "" } else { "s" };
            format!("{} with {substeps} substep{plural}", integrator.title())
        }
        Candidate::BlackBox => "the black box itself".to_owned(),
        Candidate::Net { shape, source, longer } => {
            let training = tried.result.as_ref().ok().and_then(|score| score.training_s);
            let time = training.map_or(String::new(), |s| format!(" in {s:.1} s"));
            let on = match source {
                TrainingTarget::Integrator => "the plant's trajectories (distilled)",
                TrainingTarget::Physics => "the equation",
            };
            let iterations = if longer {
                format!(", with {LONGER} times the iterations,")
            } else {
                String::new()
            };
            format!("a net of {shape} trained on {on}{iterations}{time}")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::judge::tests::score;
    use pinc_ode::Integrator;

    /// What is said of RK4 with 2 substeps, which is as good as with 16.
    fn sentences(change: impl Fn(&mut Score)) -> Vec<String> {
        sentences_beside(Vec::new(), change)
    }

    /// The same with `others` beside them.
    fn sentences_beside(others: Vec<Tried>, change: impl Fn(&mut Score)) -> Vec<String> {
        let tried = |substeps: usize, score: Score| Tried {
            candidate: Candidate::Integrator { integrator: Integrator::Rk4, substeps },
            net: None,
            repetitions: 1,
            place: String::new(),
            result: Ok(score),
        };
        let mut cheap = score(100.5, 10.0, 1e-3);
        change(&mut cheap);
        let all = [vec![tried(16, score(100.0, 50.0, 1e-9)), tried(2, cheap)], others].concat();
        let control = toml::from_str(crate::search::SPEC).unwrap();
        let search =
            Search { control: &control, sources: &[], states: 2, within: 0.01, has_equation: true };
        let found = SearchResult { tried: all, ..SearchResult::default() };
        Advice::of(&search, &found, &[]).unwrap().sentences()
    }

    #[test]
    fn the_advice_has_the_winners_numbers() {
        let said = "Use RK4 with 2 substeps: its IAE of 100.500000 is within 1 % of the IAE of the \
                    most exact model, RK4 x16, 100.000000, and its control step takes 10.0 us (99th \
                    percentile 20.0 us); no net was tried.";
        assert_eq!(sentences(|_| ()), [said]);
        let below = &sentences(|score| score.iae = 98.0)[0];
        assert!(below.contains("its IAE of 98.000000 is below the IAE of"), "{below}");
        let proven = sentences(|score| score.proven = Some(2.5e-3));
        assert!(
            proven[1].contains("proven to be wrong by at most 2.5e-3 of the widths"),
            "{proven:?}"
        );
    }

    /// The table and the advice on these models, with `more` in the config's control.
    fn advised(tried: Vec<Tried>, more: &str) -> (String, String) {
        let control = toml::from_str(&format!("{more}{}", crate::search::SPEC)).unwrap();
        let search =
            Search { control: &control, sources: &[], states: 2, within: 0.01, has_equation: true };
        let found = SearchResult { tried, ..SearchResult::default() };
        let advice = Advice::of(&search, &found, &[]).unwrap();
        (advice.to_string(), advice.sentences().remove(0))
    }

    fn of(candidate: Candidate, result: Result<Score, String>) -> Tried {
        Tried { candidate, net: None, repetitions: 1, place: String::new(), result }
    }

    fn rk(integrator: Integrator, substeps: usize, score: Score) -> Tried {
        of(Candidate::Integrator { integrator, substeps }, Ok(score))
    }

    /// The cheapest first and what failed last, each with its own numbers in the columns of the
    /// head: of an instruction count, there is a column as soon as one model has it.
    #[test]
    fn the_table_has_a_row_for_each_model() {
        let shape = crate::candidate::shapes(2)[1];
        let net = Candidate::Net { shape, source: TrainingTarget::Integrator, longer: false };
        let mut cheap = score(100.5, 10.0, 1e-3);
        (cheap.worst, cheap.proven, cheap.instructions) = (Some(2e-3), Some(1.5e-3), Some(1234));
        let wild = Score { worst: Some(f64::INFINITY), ..score(103.0, 8.0, 1e-2) };
        let tried = vec![
            of(net, Err("no such file".to_owned())),
            rk(Integrator::Rk4, 16, score(100.0, 50.0, 1e-9)),
            rk(Integrator::Rk4, 2, cheap),
            rk(Integrator::Rk5, 1, Score { training_s: Some(7.25), ..wild }),
        ];
        let shown = advised(tried, "budget_us = 60.0").0;
        let lines: Vec<&str> = shown.lines().take(5).collect();
        let words = |line: &str| line.split_whitespace().collect::<Vec<_>>().join(" ");
        let head = "model IAE step p50 us p99 us M4F instr. error found proven training s";
        assert_eq!(words(lines[0]), head, "{shown}");
        assert_eq!(
            lines[1..].iter().map(|line| words(line)).collect::<Vec<_>>(),
            [
                "RK5 x1 103.000000 8.00 16.00 - not finite - 7.2 IAE 3.00 % more",
                "RK4 x2 100.500000 10.00 20.00 1234 2.0e-3 1.5e-3 - good",
                "RK4 x16 100.000000 50.00 100.00 - - - - late",
                "distilled 2x16 no such file",
            ]
        );
        // Numbers end where the words above them do.
        let end = |line: &str, of: &str| line.find(of).map(|at| at + of.len());
        for (head, number) in [
            ("IAE", "100.500000"),
            ("step p50 us", "10.00"),
            ("p99 us", "20.00"),
            ("instr.", "1234"),
            ("error found", "2.0e-3"),
            ("proven", "1.5e-3"),
        ] {
            assert_eq!(end(lines[0], head), end(lines[2], number), "{head} in\n{shown}");
        }
        let column = |line: &str, of: &str| line.find(of).unwrap();
        assert_eq!(column(lines[1], "IAE 3"), column(lines[2], "good"), "{shown}");
        assert_eq!(column(lines[2], "good"), column(lines[3], "late"), "{shown}");
        assert!(shown.contains("; no net is as good, of 1 that were tried.\n"), "{shown}");
        // No model has a count, and there is no column of counts.
        let all = vec![rk(Integrator::Rk4, 16, score(100.0, 50.0, 1e-9))];
        let shown = advised(all, "").0;
        assert_eq!(shown.lines().next().map(words).unwrap(), head.replace(" M4F instr.", ""));
        assert_eq!(
            shown.lines().nth(1).map(words).unwrap(),
            "RK4 x16 100.000000 50.00 100.00 - - - good"
        );
    }

    /// The most exact model is compared with itself, and a budget that none keeps is said.
    #[test]
    fn the_most_exact_model_may_be_the_one_to_use() {
        let all = || vec![rk(Integrator::Rk4, 16, score(100.0, 50.0, 1e-9))];
        let said = |budget: &str| advised(all(), budget).1;
        let own = "Use RK4 with 16 substeps: its IAE of 100.000000 is the IAE of the most exact model, \
                   RK4 x16, 100.000000, and its control step takes 50.0 us (99th percentile 100.0 us); \
                   no net was tried.";
        assert_eq!(said(""), own);
        assert_eq!(said("budget_us = 100.0"), own);
        let late = format!("{own} No good model keeps within control.budget_us, 99.5 us.");
        assert_eq!(said("budget_us = 99.5"), late);
    }

    /// Beside RK5 with 1 substep, which is cheaper by less than times tell, and less exact.
    #[test]
    fn a_model_that_is_not_the_cheapest_has_a_reason() {
        let cheapest = Tried {
            candidate: Candidate::Integrator { integrator: Integrator::Rk5, substeps: 1 },
            net: None,
            repetitions: 1,
            place: String::new(),
            result: Ok(score(100.5, 9.8, 1e-2)),
        };
        let said = sentences_beside(vec![cheapest], |_| ()).remove(0);
        assert!(said.starts_with("Use RK4 with 2 substeps"), "{said}");
        assert!(said.contains("The cheapest good model, RK5 x1, takes 9.8 us"), "{said}");
        assert!(said.ends_with("an integrator is preferred, and the most exact."), "{said}");
    }

    /// By more than a tenth of its width, whatever the mean over the domain is.
    #[test]
    fn a_step_that_is_far_off_somewhere_is_mentioned() {
        let with = |worst: f64| sentences(|score| score.worst = Some(worst));
        assert_eq!(with(0.1).len(), 1);
        let words = |size: &str| {
            format!(
                "Somewhere in the domain a step of it is wrong by {size}: the loop does not go there."
            )
        };
        assert_eq!(with(0.105)[1..], [words("0.1 of its width")]);
        assert_eq!(with(2.5)[1..], [words("2.5 of its width")]);
        assert_eq!(with(f64::INFINITY)[1..], [words("all bounds")]);
    }
}
