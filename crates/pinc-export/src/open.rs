//! The parameters of a model that an estimator finds: arguments of the generated code.

use crate::template::Template;
use pinc_estimate::Augmentation;
use pinc_expr::PlantEquations;
use pinc_net::FoldedNet;

/// Which of a model's parameters are arguments of the generated one, behind the inputs, and the
/// values of the others, which become constants.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Open<'a> {
    /// p
    values: &'a [f64],
    /// The places in it of those that are arguments, in the order of these.
    estimated: &'a [usize],
}

impl<'a> Open<'a> {
    /// Those that are estimated.
    pub(crate) fn of(augmentation: &'a Augmentation) -> Self {
        Self { values: &augmentation.parameters, estimated: &augmentation.estimated }
    }

    /// All parameters; of those that are arguments, the values before there is an estimate.
    pub(crate) fn values(self) -> &'a [f64] {
        self.values
    }

    /// How many are arguments.
    pub(crate) fn count(self) -> usize {
        self.estimated.len()
    }

    /// Their values before there is an estimate.
    pub(crate) fn initial(self) -> impl Iterator<Item = f64> {
        self.estimated.iter().map(move |&place| self.values[place])
    }

    /// The equations with the others fixed, of the parameters `names`; and those that are
    /// arguments.
    pub(crate) fn equations<'n>(
        self,
        equations: &PlantEquations,
        names: &'n [String],
    ) -> (PlantEquations, Vec<&'n str>) {
        let named = names.iter().map(String::as_str).zip(self.values.iter().copied());
        let fixed = equations.clone().with_parameters(named);
        (fixed, self.estimated.iter().map(|&place| names[place].as_str()).collect())
    }

    /// The net with the others in its biases, of a net whose inputs are `before` numbers and then
    /// its parameters.
    pub(crate) fn fold(self, net: &mut FoldedNet, before: usize) {
        let first = &mut net.layers[0];
        for (row, bias) in first.weights.iter_mut().zip(&mut first.bias) {
            let parameters = row.split_off(before);
            for (place, (weight, value)) in parameters.iter().zip(self.values).enumerate() {
                if !self.estimated.contains(&place) {
                    *bias += weight * value;
                }
            }
            row.extend(self.estimated.iter().map(|&place| parameters[place]));
        }
    }

    /// Fills how wide the argument u of the model is.
    pub(crate) fn set(self, t: &mut Template) {
        let count = self.count();
        let (width, defines) = match count {
            0 => ("PINC_NU", String::new()),
            _ => (
                "(PINC_NU + PINC_NP)",
                format!(
                    "/** Number of parameters, which follow the inputs in the argument u. */\n\
                     #define PINC_NP {count}\n"
                ),
            ),
        };
        t.set("WIDTH", width).set("PARAMETERS", defines);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Name;
    use pinc_net::PlainLayer;

    /// Of four parameters the last and the second are arguments, in this order.
    fn open() -> Open<'static> {
        Open { values: &[10.0, 20.0, 30.0, 40.0], estimated: &[3, 1] }
    }

    /// The arguments keep their weights, in their order; the others go into the biases.
    #[test]
    fn a_net_is_folded_over_the_parameters_that_are_fixed() {
        let layer = |weights: Vec<Vec<f64>>, bias: Vec<f64>| PlainLayer { weights, bias };
        let first = layer(
            vec![vec![1.0, 2.0, 0.1, 0.2, 0.3, 0.4], vec![3.0, 4.0, -1.0, 5.0, 0.5, 7.0]],
            vec![100.0, 200.0],
        );
        let last = layer(vec![vec![1.0, 2.0]], vec![3.0]);
        let layers = vec![first, last.clone()];
        let mut net = FoldedNet { layers, time: vec![0.0; 2], adds_initial_state: false };
        open().fold(&mut net, 2);
        // 100 + 0.1*10 + 0.3*30, and 200 - 1*10 + 0.5*30.
        let rows = vec![vec![1.0, 2.0, 0.4, 0.2], vec![3.0, 4.0, 7.0, 5.0]];
        assert_eq!(net.layers, [layer(rows, vec![110.0, 205.0]), last]);
    }

    #[test]
    fn arguments_have_names_and_values_in_their_order() {
        assert_eq!((open().count(), open().initial().collect::<Vec<_>>()), (2, vec![40.0, 20.0]));
        let text = |open: Open<'_>| {
            let mut template = Template::new(&Name::new("tank").unwrap());
            open.set(&mut template);
            template.fill("@PARAMETERS@double u[@WIDTH@];")
        };
        assert_eq!(text(Open::default()), "double u[TANK_NU];");
        let two = text(open());
        assert!(two.ends_with("#define TANK_NP 2\ndouble u[(TANK_NU + TANK_NP)];"), "{two}");
    }
}
