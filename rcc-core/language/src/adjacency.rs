//! The edges of a graph: the neighbours of each node, in one block of memory for all nodes. Runs on the loader's
//! threads.

/// Neighbours by node.
#[derive(Clone, Debug, Default)]
pub struct Adjacency {
    /// Where the neighbours of a node end, and those of the next one begin.
    ends: Vec<usize>,
    neighbours: Vec<usize>,
}

/// Collects the neighbours of each node, in the order of the nodes.
impl<N: IntoIterator<Item = usize>> FromIterator<N> for Adjacency {
    fn from_iter<I: IntoIterator<Item = N>>(nodes: I) -> Adjacency {
        let mut edges = Adjacency::default();
        for neighbours in nodes {
            edges.neighbours.extend(neighbours);
            edges.ends.push(edges.neighbours.len());
        }
        edges
    }
}

impl Adjacency {
    /// Returns the number of nodes.
    #[must_use]
    pub fn count(&self) -> usize {
        self.ends.len()
    }

    /// Returns the neighbours of a node; none if it does not exist.
    #[must_use]
    pub fn of(&self, node: usize) -> &[usize] {
        let end = self.ends.get(node).copied().unwrap_or(0);
        let begin = node.checked_sub(1).and_then(|before| self.ends.get(before));
        self.neighbours
            .get(begin.copied().unwrap_or(0)..end)
            .unwrap_or(&[])
    }

    /// Returns the nodes with their neighbours.
    pub fn rows(&self) -> impl Iterator<Item = (usize, &[usize])> {
        (0..self.count()).map(|node| (node, self.of(node)))
    }

    /// Returns the edges in the other direction: for each of `count` neighbours the nodes that have it, in order. Every
    /// neighbour is less than `count`.
    #[must_use]
    pub fn reversed(&self, count: usize) -> Adjacency {
        // Counts the nodes of each neighbour, then writes each of them behind the one before.
        let mut ends = vec![0; count];
        for neighbour in &self.neighbours {
            ends[*neighbour] += 1;
        }
        let mut begin = 0;
        for end in &mut ends {
            (*end, begin) = (begin, begin + *end);
        }
        let mut neighbours = vec![0; self.neighbours.len()];
        for (node, row) in self.rows() {
            for neighbour in row {
                neighbours[ends[*neighbour]] = node;
                ends[*neighbour] += 1;
            }
        }
        Adjacency { ends, neighbours }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_kept_in_order_and_can_be_reversed() {
        let edges: Adjacency = [vec![2, 2], vec![], vec![0, 1]].into_iter().collect();
        assert_eq!(edges.count(), 3);
        assert_eq!(
            [0, 1, 2, 3].map(|node| edges.of(node)),
            [&[2, 2][..], &[], &[0, 1], &[]]
        );
        let reversed = edges.reversed(4);
        assert_eq!(reversed.count(), 4);
        assert_eq!(
            [0, 1, 2, 3].map(|node| reversed.of(node)),
            [&[2][..], &[2], &[0, 0], &[]]
        );
    }
}
