//! The table of metrics.

use pinc_record::metric::{Better, Metric, Of, Unit};

/// The table of docs/metrics.md.
pub(super) fn table() -> String {
    let head = "| metric | in `metrics.json` | column | unit | better |\n|---|---|---|---|---|\n";
    let code = |text: String| format!("`{text}`");
    let row = |metric: &Metric| {
        let (section, model) = match metric.of {
            Of::Name(_) | Of::Training(_) => ("training", ""),
            Of::Validation(_) => ("validation", ""),
            Of::Domain(_) => ("validation.domain_error", ""),
            Of::FreeRun(_) => ("prediction", ""),
            Of::Loop(_) => ("control[]", "MODEL_"),
            Of::OneStep(_) => ("one_step[]", "MODEL_"),
        };
        let unit = match metric.unit {
            Unit::States(power) => format!("state unit{power}"),
            Unit::Errors(unit) | Unit::Clock(unit, _) => unit.to_owned(),
            Unit::Count | Unit::One => "1".to_owned(),
            Unit::Name => String::new(),
        };
        let better = match metric.better {
            Better::Lower => "lower",
            Better::Neither => "",
        };
        let given = |text: &str, prefix: String| match text {
            "" => String::new(),
            text => code(format!("{prefix}{text}")),
        };
        let path = given(metric.path, format!("{section}."));
        let column = given(metric.column, model.to_owned());
        format!("| {} | {path} | {column} | {unit} | {better} |\n", metric.title)
    };
    head.to_owned() + &Metric::all().map(row).collect::<String>()
}
