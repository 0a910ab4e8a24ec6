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
