//! What is saved of a controller, and restored.

use pinc_mpc::{Bounds, Nmpc, NmpcProblem, SqpConfig, Tracked, Weights};
use pinc_ode::{Dims, Linearization, Memory, Model, OutputLinearization, Rk4, Stages};
use pinc_plants::FourTanks;
use pinc_tube::{EllipsoidTube, Feedback, Sources, TubeModel};

const N: usize = 6;

fn model() -> Rk4<FourTanks> {
    Rk4::new(FourTanks::antonelo(), 10.0, 4)
}

fn problem() -> NmpcProblem {
    let dims = Dims::new(4, 2);
    NmpcProblem {
        tracked: Tracked::states([0, 1]),
        input_bounds: Bounds::new(vec![0.0; 2], vec![3.6; 2]),
        ..NmpcProblem::new(dims, N, Weights::uniform(vec![10.0; 2], vec![1.0; 2]))
    }
}

fn plain() -> Nmpc {
    Nmpc::new(problem(), Box::new(model()), SqpConfig::default()).unwrap()
}

fn in_real_time() -> Nmpc {
    let config = SqpConfig { real_time: true, ..SqpConfig::default() };
    Nmpc::new(problem(), Box::new(model()), config).unwrap()
}

fn with_tube() -> Nmpc {
    let sources = Sources { boxes: vec![0.05; 4], ..Sources::default() };
    let units = vec![10.0; 4];
    let dims = (model().dims(), N);
    let tube = EllipsoidTube::new(dims, sources, None, Feedback::Riccati, units).unwrap();
    let bounded = NmpcProblem {
        state_bounds: Bounds::new(vec![2.0, 2.0, 0.6, 0.6], vec![9.0, 20.0, 5.5, 5.5]),
        ..problem()
    };
    Nmpc::builder(bounded).model(Box::new(model())).tube(Box::new(tube)).build().unwrap()
}

/// The tanks with the output h1 + h2, and h1 + 0.4 u1 if there are two.
#[derive(Clone, Debug)]
struct WithSum(Rk4<FourTanks>, usize);

impl Model for WithSum {
    fn dims(&self) -> Dims {
        self.0.dims().with_outputs(self.1)
    }

    fn sample_time_s(&self) -> f64 {
        self.0.sample_time_s()
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        self.0.step(x, u, p, next);
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        self.0.linearize(at, out);
    }

    fn output(&mut self, x: &[f64], u: &[f64], _p: &[f64], y: &mut [f64]) {
        y.copy_from_slice(&[x[0] + x[1], x[0] + 0.4 * u[0]][..self.1]);
    }

    fn feedthrough(&self) -> Vec<bool> {
        [false, true][..self.1].to_vec()
    }

    fn linearize_output(&mut self, at: Stages<'_>, out: OutputLinearization<'_>) {
        let ny = self.1;
        for (k, (x, u)) in at.x.chunks_exact(4).zip(at.u.chunks_exact(2)).enumerate() {
            self.output(x, u, &[], &mut out.y[k * ny..(k + 1) * ny]);
        }
        let c = [1.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
        out.c.chunks_exact_mut(4 * ny).for_each(|rows| rows.copy_from_slice(&c[..4 * ny]));
        let d = [0.0, 0.0, 0.4, 0.0];
        out.d.chunks_exact_mut(2 * ny).for_each(|rows| rows.copy_from_slice(&d[..2 * ny]));
    }
}

/// The bound of the output is below what the references ask for, and a tube moves it in each step.
fn with_tube_in_real_time() -> Nmpc {
    let config = SqpConfig { real_time: true, ..SqpConfig::default() };
    with_outputs(1, &[22.4], config)
}

/// The bounds of an output that depends on the input have rows at both ends of an interval.
fn with_tube_and_an_input_in_an_output() -> Nmpc {
    with_outputs(2, &[22.4, 11.0], SqpConfig::default())
}

fn with_outputs(ny: usize, high: &[f64], config: SqpConfig) -> Nmpc {
    let sources = Sources { boxes: vec![0.05; 4], ..Sources::default() };
    let units = vec![10.0; 4];
    let sum = WithSum(model(), ny);
    let follows = TubeModel { model: Box::new(sum.clone()), more: Vec::new() };
    let tube =
        EllipsoidTube::new((sum.dims(), N), sources, Some(follows), Feedback::Riccati, units);
    let bounds = Bounds::new(vec![f64::NEG_INFINITY; ny], high.to_vec());
    let bounded = NmpcProblem { output_bounds: Some(bounds), ..problem() };
    let builder = Nmpc::builder(bounded).model(Box::new(sum)).config(config);
    builder.tube(Box::new(tube.unwrap())).build().unwrap()
}

fn save(nmpc: &mut Nmpc) -> Vec<f64> {
    let mut numbers = Vec::new();
    nmpc.remember(&mut Memory::save(&mut numbers));
    numbers
}

/// A step at `x`, with the next one prepared, and where it leads.
fn step(nmpc: &mut Nmpc, x: &mut Vec<f64>) -> Vec<u64> {
    let u = nmpc.step(x, &[9.2, 14.2].repeat(N)).unwrap().u.to_vec();
    nmpc.prepare();
    let mut next = vec![0.0; 4];
    model().step(x, &u, &[], &mut next);
    // The plant is disturbed.
    next.iter_mut().for_each(|level| *level += 0.02);
    *x = next;
    u.into_iter().map(f64::to_bits).collect()
}

/// Saving is no step and changes nothing, and what was restored goes on to the same bits.
#[test]
fn a_controller_goes_on_as_if_it_had_never_been_saved() {
    for (what, controller) in [
        ("plain", plain as fn() -> Nmpc),
        ("in real time", in_real_time),
        ("tube", with_tube),
        ("tube in real time", with_tube_in_real_time),
        ("tube and an input in an output", with_tube_and_an_input_in_an_output),
    ] {
        let [mut whole, mut watched] = [controller(), controller()];
        let start = vec![8.5, 13.0, 2.2, 2.2];
        let [mut x, mut of_watched] = [start.clone(), start];
        for k in 0..12 {
            let numbers = save(&mut watched);
            let (mut restored, mut of_restored) = (controller(), x.clone());
            let mut memory = Memory::restore(&numbers);
            restored.remember(&mut memory);
            assert!(memory.is_complete(), "{what}, step {k}");
            let bits = |numbers: &[f64]| numbers.iter().map(|n| n.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&save(&mut restored)), bits(&numbers), "{what}, step {k}");
            let expected = step(&mut whole, &mut x);
            assert_eq!(step(&mut watched, &mut of_watched), expected, "{what}, step {k}");
            assert_eq!(
                step(&mut restored, &mut of_restored),
                expected,
                "{what}, step {k}: restored"
            );
        }
    }
}
