//! The shape of a scenario tree.

/// A tree of control stages. Its root is the measured state; each node of the first few depths has
/// the same number of children, each later node has one, so that every path from the root is as
/// long as the horizon. A chain is the tree without branching.
///
/// Nodes are numbered depth by depth from the root, 0; children of one node follow one another. The
/// stage that leads to node j + 1 has the number j.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tree {
    /// The number of children of a node that branches.
    branches: usize,
    /// How many nodes the branching part has: the root, and all children of nodes that branch.
    fan: usize,
    /// The number of paths.
    scenarios: usize,
}

impl Tree {
    /// One path.
    pub const CHAIN: Self = Self { branches: 1, fan: 1, scenarios: 1 };

    /// A tree whose nodes of the first `depths` depths have `branches` children each; `None` if
    /// its paths cannot be counted.
    #[must_use]
    pub fn new(branches: usize, depths: usize) -> Option<Self> {
        let mut tree = Self::CHAIN;
        if branches == 1 {
            return Some(tree);
        }
        for _ in 0..depths {
            tree.scenarios = tree.scenarios.checked_mul(branches)?;
            tree.fan = tree.fan.checked_add(tree.scenarios)?;
        }
        Some(Self { branches, ..tree })
    }

    /// Whether there is one path only.
    #[must_use]
    #[inline]
    pub fn is_chain(self) -> bool {
        self.scenarios == 1
    }

    /// The number of paths from the root.
    #[must_use]
    #[inline]
    pub fn scenarios(self) -> usize {
        self.scenarios
    }

    /// The node that stage `j` leads from.
    #[must_use]
    #[inline]
    pub fn origin(self, j: usize) -> usize {
        if self.is_branching(j) { self.origin_at_branching(j) } else { j + 1 - self.scenarios }
    }

    /// Out of line, so that loops stay short.
    #[cold]
    #[inline(never)]
    fn origin_at_branching(self, j: usize) -> usize {
        j / self.branches
    }

    /// The node that the first path comes to after the last branching; those of the other paths
    /// follow.
    #[must_use]
    #[inline]
    pub(crate) fn first_chain_node(self) -> usize {
        self.fan - self.scenarios
    }

    /// The children of a node in a tree without end.
    #[inline]
    pub(crate) fn children(self, node: usize) -> std::ops::Range<usize> {
        let first = node * self.branches + 1;
        if first < self.fan {
            first..first + self.branches
        } else {
            node + self.scenarios..node + self.scenarios + 1
        }
    }

    /// Whether stage `j` is one of several that leave its node.
    #[must_use]
    #[inline]
    pub fn is_branching(self, j: usize) -> bool {
        j + 1 < self.fan
    }

    /// The branch by which stage `j` leaves its node; after the last branching, the branch that was
    /// taken there.
    #[must_use]
    pub fn branch(self, j: usize) -> usize {
        j.checked_sub(self.fan - 1).unwrap_or(j) % self.branches
    }

    /// The number of stages between the root and a node.
    #[must_use]
    pub fn depth(self, node: usize) -> usize {
        let (mut node, mut depth) = (node, 0);
        while node > 0 {
            (node, depth) = (self.origin(node - 1), depth + 1);
        }
        depth
    }

    /// The first node of a depth; the number of nodes above it.
    #[must_use]
    pub fn first_node(self, depth: usize) -> usize {
        let (mut first, mut width) = (0, 1);
        for _ in 0..depth {
            first += width;
            width = (width * self.branches).min(self.scenarios);
        }
        first
    }

    /// The node whose plan a node takes over when the tree is shifted by one stage along the first
    /// branch: one stage deeper, after the same branches as far as there are such nodes.
    #[must_use]
    pub fn successor(self, node: usize) -> usize {
        if node + self.scenarios >= self.fan {
            return node + self.scenarios;
        }
        // The first node of the depth below follows from the first branch at the root.
        let depth = self.depth(node);
        self.first_node(depth + 1) + node - self.first_node(depth)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chain_goes_from_node_to_node() {
        for tree in [Tree::CHAIN, Tree::new(1, 3).unwrap()] {
            assert!(tree.is_chain());
            for j in 0..5 {
                assert_eq!((tree.origin(j), tree.children(j)), (j, j + 1..j + 2));
                assert_eq!((tree.branch(j), tree.depth(j), tree.first_node(j)), (0, j, j));
                assert_eq!(tree.successor(j), j + 1);
            }
        }
    }

    /// Three branches at the root and at its children: 1 + 3 + 9 + 9 + .. nodes.
    #[test]
    fn nodes_are_numbered_depth_by_depth() {
        let tree = Tree::new(3, 2).unwrap();
        assert_eq!((tree.scenarios(), tree.is_chain()), (9, false));
        assert_eq!(
            (0..5).map(|depth| tree.first_node(depth)).collect::<Vec<_>>(),
            [0, 1, 4, 13, 22]
        );
        for (node, origin, branch, depth) in [
            (1, 0, 0, 1),
            (3, 0, 2, 1),
            (4, 1, 0, 2),
            (8, 2, 1, 2),
            (12, 3, 2, 2),
            (13, 4, 0, 3),
            (17, 8, 1, 3),
            (21, 12, 2, 3),
            (26, 17, 1, 4),
        ] {
            assert_eq!((tree.origin(node - 1), tree.branch(node - 1)), (origin, branch), "{node}");
            assert_eq!(tree.depth(node), depth, "{node}");
            assert!(tree.children(origin).contains(&node), "{node}");
        }
        assert_eq!(tree.children(2), 7..10);
        assert_eq!(tree.children(5), 14..15);
        assert_eq!(Tree::new(usize::MAX, 2), None);
    }

    #[test]
    fn a_node_takes_over_from_the_node_one_stage_deeper() {
        // After the first branch at the root.
        let tree = Tree::new(3, 2).unwrap();
        assert_eq!([0, 1, 2, 3].map(|node| tree.successor(node)), [1, 4, 5, 6]);
        // After the same two branches.
        assert_eq!([4, 8, 12, 17].map(|node| tree.successor(node)), [13, 17, 21, 26]);
        let tree = Tree::new(2, 1).unwrap();
        assert_eq!([0, 1, 2, 3].map(|node| tree.successor(node)), [1, 3, 4, 5]);
    }
}
