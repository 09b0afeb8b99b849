//! Disjoint sets of indices.

/// Sets that only grow; the smallest member leads each, so that the result does not depend on
/// the order of joins.
#[derive(Clone, Debug, Default)]
pub struct Union {
    parent: Vec<usize>,
}

impl Union {
    /// Every index below `n` in a set of its own.
    pub fn new(n: usize) -> Self {
        Self {
            parent: (0..n).collect(),
        }
    }

    /// Smallest member of the set of `i`; it halves the paths.
    pub fn leader(&mut self, mut i: usize) -> usize {
        while self.parent[i] != i {
            self.parent[i] = self.parent[self.parent[i]];
            i = self.parent[i];
        }
        i
    }

    /// Joins what either of two families of the same size joins.
    pub fn with(mut self, other: Self) -> Self {
        for (i, j) in other.parent.into_iter().enumerate() {
            self.join(i, j);
        }
        self
    }

    /// Joins the sets of `i` and `j`.
    pub fn join(&mut self, i: usize, j: usize) {
        // They are usually in one set already, and next to its leader.
        if self.parent[i] == self.parent[j] {
            return;
        }
        let (a, b) = (self.leader(i), self.leader(j));
        self.parent[a.max(b)] = a.min(b);
    }

    /// The set of each index, numbered in the order of their smallest members.
    pub fn numbers(mut self) -> Vec<usize> {
        let mut number = vec![usize::MAX; self.parent.len()];
        let mut count = 0;
        (0..number.len())
            .map(|i| {
                let leader = self.leader(i);
                if number[leader] == usize::MAX {
                    number[leader] = count;
                    count += 1;
                }
                number[leader]
            })
            .collect()
    }
}
