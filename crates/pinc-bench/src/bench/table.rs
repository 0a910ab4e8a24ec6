//! The measurements as text.

use super::results::BenchReport;
use std::fmt;

impl fmt::Display for BenchReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let machine = &self.machine;
        writeln!(f, "{}, {} threads, {}", machine.cpu, machine.cores, machine.isa.join(" "))?;
        writeln!(f, "{}, {}, {} build", machine.target, machine.rustc, machine.profile)?;
        if self.quick {
            writeln!(f, "quick: small sizes, few repetitions; the times say little")?;
        }
        let peak = &self.fma_peak_gflops;
        writeln!(
            f,
            "multiply-add peak, f64: {:.1} GFLOP/s on one thread, {:.1} on all",
            peak.f64_1, peak.f64_all
        )?;
        self.loss_gradient_table(f)?;
        if self.model_step.is_empty() {
            return Ok(());
        }
        self.model_step_table(f)?;
        self.control_tables(f)
    }
}

impl BenchReport {
    fn loss_gradient_table(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "\nloss and gradient, f64")?;
        writeln!(
            f,
            "{:<12} {:>6} {:>7} {:>8} {:>9} {:>9} {:>8} {:>8}",
            "plant", "net", "points", "threads", "isa", "ms", "GFLOP/s", "of peak"
        )?;
        for row in &self.loss_gradient {
            writeln!(
                f,
                "{:<12} {:>6} {:>7} {:>8} {:>9} {:>9.2} {:>8.1} {:>6.0} %",
                row.plant,
                row.layers,
                row.points,
                row.threads,
                row.isa,
                row.ms,
                row.gflops,
                100.0 * row.fraction_of_peak
            )?;
        }
        Ok(())
    }

    fn model_step_table(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "\none step of a model")?;
        writeln!(
            f,
            "{:<12} {:<13} {:>10} {:>15} {:>12}  trained",
            "plant", "model", "forward", "with Jacobians", "rms error"
        )?;
        for row in &self.model_step {
            let detail = match (&row.layers, row.substeps) {
                (Some(layers), _) => format!("{} {layers}", row.model),
                (None, Some(substeps)) => {
                    let text = if row.as_text { " text" } else { "" };
                    format!("{} x{substeps}{text}", row.model)
                }
                (None, None) => row.model.to_owned(),
            };
            let trained = row.trained_s.map_or_else(String::new, |s| format!("{s:.1} s"));
            writeln!(
                f,
                "{:<12} {:<13} {:>7.0} ns {:>12.0} ns {:>12.1e}  {trained}",
                row.plant, detail, row.forward_ns, row.forward_jacobian_ns, row.one_step_rms
            )?;
        }
        Ok(())
    }

    fn control_tables(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "\none quadratic program (with the SQP's checks)")?;
        for row in &self.qp {
            writeln!(f, "{:<12} {:<10} {:>7.1} us", row.plant, row.solver, row.us)?;
        }
        writeln!(f, "\none step of the controller in closed loop")?;
        write!(
            f,
            "{:<12} {:<6} {:>8} {:>9} {:>9} {:>9} {:>8} {:>10}",
            "plant", "model", "KKT", "p50 us", "p99 us", "max us", "QPs", "converged"
        )?;
        for row in &self.nmpc {
            let times = &row.step_us;
            write!(
                f,
                "\n{:<12} {:<6} {:>8.0e} {:>9.1} {:>9.1} {:>9.1} {:>8.2} {:>8.0} %",
                row.plant,
                row.model,
                row.kkt_tol,
                times.p50,
                times.p99,
                times.max,
                row.sqp_iterations_mean,
                100.0 * row.converged
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::results::{FmaPeak, LossGradient, ModelStep, NmpcTimes, QpTime};
    use pinc_record::StepTimes;
    use pinc_runs::invocation::invocation;

    /// Each measured number is in the column of its head, shares in percent.
    #[test]
    fn each_number_stands_below_its_head() {
        let mut report = BenchReport::begin(true, invocation(&[]));
        report.fma_peak_gflops = FmaPeak { f64_1: 41.25, f64_all: 160.0 };
        report.loss_gradient.push(LossGradient {
            plant: "van-der-pol",
            layers: "4x20".to_owned(),
            points: 2020,
            initial_points: 20,
            precision: "f64",
            threads: 3,
            isa: "avx2".to_owned(),
            ms: 1.25,
            gflops: 10.5,
            fraction_of_peak: 0.26,
            repetitions: 9,
        });
        let alone = report.to_string();
        assert!(alone.contains("f64: 41.2 GFLOP/s on one thread, 160.0 on all"), "{alone}");
        assert!(alone.contains("\nquick: small sizes"), "{alone}");
        assert!(!alone.contains("one step of a model"), "{alone}");
        let words = |text: &str, begin: &str| -> Vec<String> {
            let line = text.lines().rfind(|line| line.starts_with(begin)).unwrap();
            line.split_whitespace().map(str::to_owned).collect()
        };
        let found = words(&alone, "van-der-pol");
        assert_eq!(found, ["van-der-pol", "4x20", "2020", "3", "avx2", "1.25", "10.5", "26", "%"]);

        let model = |model, layers: Option<&str>, substeps, as_text| ModelStep {
            plant: "four-tanks",
            model,
            layers: layers.map(str::to_owned),
            substeps,
            as_text,
            trained_s: layers.map(|_| 2.04),
            forward_ns: 1234.0,
            forward_jacobian_ns: 5678.0,
            one_step_rms: 1.5e-3,
        };
        report.quick = false;
        report.model_step = vec![
            model("pinc", Some("2x8"), None, false),
            model("rk4", None, Some(4), false),
            model("rk4", None, Some(4), true),
        ];
        report.qp.push(QpTime { plant: "a", solver: "dense".to_owned(), us: 12.34, note: "" });
        report.nmpc.push(NmpcTimes {
            plant: "b",
            model: "rk4",
            kkt_tol: 1e-6,
            step_us: StepTimes { p50: 10.0, p99: 20.0, max: 30.0 },
            sqp_iterations_mean: 1.75,
            converged: 0.98,
            qp_solver: "dense".to_owned(),
        });
        let text = report.to_string();
        assert!(!text.contains("quick"), "{text}");
        let steps: Vec<_> = text.lines().filter(|line| line.starts_with("four-tanks")).collect();
        for (line, name, end) in [
            (steps[0], "pinc 2x8 ", "2.0 s"),
            (steps[1], "rk4 x4 ", "1.5e-3"),
            (steps[2], "rk4 x4 text ", "1.5e-3"),
        ] {
            assert!(line.contains(name) && line.trim_end().ends_with(end), "{line}");
            assert!(line.contains(" 1234 ns ") && line.contains(" 5678 ns "), "{line}");
        }
        assert_eq!(words(&text, "a "), ["a", "dense", "12.3", "us"]);
        let found = words(&text, "b ");
        assert_eq!(found, ["b", "rk4", "1e-6", "10.0", "20.0", "30.0", "1.75", "98", "%"]);
        let json: serde_json::Value = serde_json::from_str(&report.to_json()).unwrap();
        assert_eq!(json["nmpc"][0]["step_us"]["p99"], 20.0);
        assert_eq!(json["model_step"][1].get("layers"), None);
    }
}
