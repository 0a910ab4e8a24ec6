//! From values to code: steps grouped by operation, on registers.

use super::dag::{Dag, DagNode, Id, Op};
use crate::error::ExpressionProblem;
use crate::graph::Function;
use std::collections::HashMap;

/// A step's registers: the operands a, b, c and the result. A step that has a second result has the
/// register of that in the place of b.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    pub(super) operands: [u16; 3],
    pub(super) to: u16,
}

/// Steps of one operation, one after the other.
#[derive(Clone, Copy, Debug)]
pub(super) struct Group {
    pub(super) op: Op,
    /// The first step, and the one after the last.
    pub(super) begin: usize,
    pub(super) end: usize,
}

/// Steps in groups, so that the operation is looked up once a group.
///
/// The variables have the first registers, the constants some others, which no step overwrites. Any
/// other is taken again once its value has been used for the last time.
#[derive(Clone, Debug)]
pub(super) struct Code {
    pub(super) groups: Vec<Group>,
    pub(super) steps: Vec<Step>,
    /// The first register after the variables, which has the first constant.
    pub(super) first: usize,
    pub(super) constants: Vec<f64>,
    /// The register of each result.
    pub(super) results: Vec<u16>,
    pub(super) registers: usize,
}

impl Code {
    /// The code that leads from the variables to `results`, with registers from `first` on.
    pub(super) fn new(dag: &Dag, first: usize, results: &[Id]) -> Result<Self, ExpressionProblem> {
        let (mut nodes, mut uses) = fused(dag, results);
        let pairs = paired(&mut nodes, &mut uses);
        let order = grouped(&nodes, &uses, &pairs);
        let mut allocation = Allocation::new(first, &nodes, uses, pairs);
        let (mut groups, mut steps) = (Vec::new(), Vec::new());
        for (op, ids) in order {
            let begin = steps.len();
            steps.extend(ids.into_iter().map(|id| (id, allocation.step(&nodes, id))));
            groups.push(Group { op, begin, end: steps.len() });
        }
        let needed = allocation.needed;
        let narrow = |register: usize| {
            u16::try_from(register).map_err(|_| ExpressionProblem::TooLarge(needed))
        };
        narrow(needed)?;
        let narrow_step = |(_, (operands, to)): (Id, ([usize; 3], usize))| {
            let [a, b, c] = operands;
            Ok(Step { operands: [narrow(a)?, narrow(b)?, narrow(c)?], to: narrow(to)? })
        };
        let steps = steps.into_iter().map(narrow_step).collect::<Result<_, _>>()?;
        let results = results.iter().map(|result| narrow(allocation.place[*result]));
        let results = results.collect::<Result<_, _>>()?;
        let constants = allocation.constants;
        Ok(Self { groups, steps, first, constants, results, registers: needed })
    }
}

/// The nodes with products that are used in one sum only as part of this sum, and how often each is
/// used: 0 times if no result needs it.
fn fused(dag: &Dag, results: &[Id]) -> (Vec<DagNode>, Vec<usize>) {
    let mut nodes = dag.nodes.clone();
    let mut uses = vec![0; nodes.len()];
    for &result in results {
        uses[result] += 1;
    }
    for id in (0..nodes.len()).rev() {
        if uses[id] > 0 {
            nodes[id].operands().iter().for_each(|&operand| uses[operand] += 1);
        }
    }
    for id in 0..nodes.len() {
        if uses[id] == 0 {
            continue;
        }
        let [a, b, _] = nodes[id].operands;
        let product = |id: Id| nodes[id].op == Op::Mul && uses[id] == 1;
        let (op, taken, rest) = match nodes[id].op {
            Op::Add if product(a) && a != b => (Op::MulAdd, a, b),
            Op::Add if product(b) && a != b => (Op::MulAdd, b, a),
            Op::Sub if product(b) && a != b => (Op::NegMulAdd, b, a),
            Op::Sub if product(a) && a != b => (Op::MulSub, a, b),
            _ => continue,
        };
        let [x, y, _] = nodes[taken].operands;
        nodes[id] = DagNode { op, operands: [x, y, rest] };
        uses[taken] = 0;
    }
    (nodes, uses)
}

/// Sine and cosine of one value come from one step: of each node that is a cosine so, the node of
/// the sine.
#[derive(Debug)]
struct Pairs {
    sines: HashMap<Id, Id>,
    cosines: HashMap<Id, Id>,
}

impl Pairs {
    /// The node in whose step a value is computed.
    fn step_of(&self, id: Id) -> Id {
        self.sines.get(&id).copied().unwrap_or(id)
    }
}

/// Makes steps of two results of sines and cosines.
fn paired(nodes: &mut [DagNode], uses: &mut [usize]) -> Pairs {
    let mut of_value: HashMap<Id, [Option<Id>; 2]> = HashMap::new();
    for id in (0..nodes.len()).filter(|&id| uses[id] > 0) {
        let place = match nodes[id].op {
            Op::Function(Function::Sin) => 0,
            Op::Function(Function::Cos) => 1,
            _ => continue,
        };
        of_value.entry(nodes[id].operands[0]).or_default()[place] = Some(id);
    }
    let mut pairs = Pairs { sines: HashMap::new(), cosines: HashMap::new() };
    for (value, pair) in of_value {
        if let [Some(sine), Some(cosine)] = pair {
            nodes[sine].op = Op::SineCosine;
            // One step is one use.
            uses[value] -= 1;
            pairs.sines.insert(cosine, sine);
            pairs.cosines.insert(sine, cosine);
        }
    }
    pairs
}

/// The nodes that are used, in groups of one operation each. Of the operations for which nodes are
/// ready, that comes first of which the largest part is, so that as much as possible of it goes
/// together.
fn grouped(nodes: &[DagNode], uses: &[usize], pairs: &Pairs) -> Vec<(Op, Vec<Id>)> {
    let is_step =
        |id: Id| uses[id] > 0 && nodes[id].op.arity() > 0 && !pairs.sines.contains_key(&id);
    let mut missing = vec![0; nodes.len()];
    let mut users: Vec<Vec<Id>> = vec![Vec::new(); nodes.len()];
    let mut kinds: Vec<Kind> = Vec::new();
    let mut ready = Vec::new();
    for id in (0..nodes.len()).filter(|&id| is_step(id)) {
        let operands = nodes[id].operands().iter().map(|&operand| pairs.step_of(operand));
        for operand in operands.filter(|&operand| is_step(operand)) {
            missing[id] += 1;
            users[operand].push(id);
        }
        kind(&mut kinds, nodes[id].op).remaining += 1;
        if missing[id] == 0 {
            ready.push(id);
        }
    }
    let mut order = Vec::new();
    loop {
        for id in ready.drain(..) {
            kind(&mut kinds, nodes[id].op).ready.push(id);
        }
        // The largest part; of equal ones the most.
        let next = kinds.iter_mut().filter(|kind| !kind.ready.is_empty()).max_by(|a, b| {
            let (x, y) = (a.ready.len() * b.remaining, b.ready.len() * a.remaining);
            x.cmp(&y).then(a.ready.len().cmp(&b.ready.len()))
        });
        let Some(next) = next else { return order };
        next.remaining -= next.ready.len();
        let ids = std::mem::take(&mut next.ready);
        for &user in ids.iter().flat_map(|&id| &users[id]) {
            missing[user] -= 1;
            if missing[user] == 0 {
                ready.push(user);
            }
        }
        ready.sort_unstable();
        order.push((next.op, ids));
    }
}

/// The nodes of an operation that are not in a group yet.
struct Kind {
    op: Op,
    ready: Vec<Id>,
    remaining: usize,
}

fn kind(kinds: &mut Vec<Kind>, op: Op) -> &mut Kind {
    let place = kinds.iter().position(|kind| kind.op == op).unwrap_or_else(|| {
        kinds.push(Kind { op, ready: Vec::new(), remaining: 0 });
        kinds.len() - 1
    });
    &mut kinds[place]
}

/// Which values are in which registers.
struct Allocation {
    place: Vec<usize>,
    uses: Vec<usize>,
    pairs: Pairs,
    constants: Vec<f64>,
    free: Vec<usize>,
    needed: usize,
}

impl Allocation {
    fn new(first: usize, nodes: &[DagNode], uses: Vec<usize>, pairs: Pairs) -> Self {
        let (mut place, mut constants) = (vec![0; nodes.len()], Vec::new());
        for (id, node) in nodes.iter().enumerate() {
            match node.op {
                Op::Variable(index) => place[id] = index,
                Op::Constant(number) if uses[id] > 0 => {
                    place[id] = first + constants.len();
                    constants.push(number.value());
                }
                _ => {}
            }
        }
        let needed = first + constants.len();
        Self { place, uses, pairs, constants, free: Vec::new(), needed }
    }

    /// The registers of a node's operands and its own. A step reads before it writes, so that its
    /// result may replace an operand.
    fn step(&mut self, nodes: &[DagNode], id: Id) -> ([usize; 3], usize) {
        let operands = nodes[id].operands();
        let mut places = [0; 3];
        for (place, &operand) in places.iter_mut().zip(operands) {
            *place = self.place[operand];
            self.uses[operand] -= 1;
        }
        for (i, &operand) in operands.iter().enumerate() {
            let first = !operands[..i].contains(&operand);
            if first && self.uses[operand] == 0 && nodes[operand].op.arity() > 0 {
                self.free.push(self.place[operand]);
            }
        }
        self.place[id] = self.take();
        if let Some(&cosine) = self.pairs.cosines.get(&id) {
            places[1] = self.take();
            self.place[cosine] = places[1];
        }
        (places, self.place[id])
    }

    fn take(&mut self) -> usize {
        self.free.pop().unwrap_or_else(|| {
            self.needed += 1;
            self.needed - 1
        })
    }
}
