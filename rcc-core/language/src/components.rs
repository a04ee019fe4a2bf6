//! Strongly connected components and cycles of a graph that is given by the sources of each node. Without recursion: a
//! net may be a chain of a hundred thousand primitives. Tarjan, "Depth-first search and linear graph algorithms", SIAM
//! J. Comput. 1 (1972). Runs on the loader's threads.

use std::collections::{BTreeMap, VecDeque};

use crate::adjacency::Adjacency;

/// The strongly connected components of a graph.
#[derive(Debug)]
pub struct Components {
    /// Number of the component, by node.
    of: Vec<usize>,
}

/// Marks a node that has not been visited.
const NEW: usize = usize::MAX;

struct Search<'a> {
    sources: &'a Adjacency,
    order: Vec<usize>,
    low: Vec<usize>,
    on_stack: Vec<bool>,
    stack: Vec<usize>,
    /// The nodes from the root of the search to where it is, each with the number of its sources that were followed.
    path: Vec<(usize, usize)>,
    of: Vec<usize>,
    visited: usize,
    components: usize,
}

impl Components {
    /// Computes the components.
    #[must_use]
    pub fn of(sources: &Adjacency) -> Components {
        let count = sources.count();
        let mut search = Search {
            sources,
            order: vec![NEW; count],
            low: vec![NEW; count],
            on_stack: vec![false; count],
            stack: Vec::new(),
            path: Vec::new(),
            of: vec![NEW; count],
            visited: 0,
            components: 0,
        };
        for node in 0..count {
            if search.order[node] == NEW {
                search.from(node);
            }
        }
        Components { of: search.of }
    }

    /// Returns true if both nodes depend on each other, or are the same node.
    #[must_use]
    pub fn same(&self, a: usize, b: usize) -> bool {
        self.of.get(a) == self.of.get(b)
    }

    /// Returns the components that contain a cycle, each in order of its nodes.
    #[must_use]
    pub fn loops(&self, sources: &Adjacency) -> Vec<Vec<usize>> {
        let in_loops = self.in_loops(sources);
        let mut loops: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (node, component) in self.of.iter().enumerate() {
            if in_loops.get(node) == Some(&true) {
                loops.entry(*component).or_default().push(node);
            }
        }
        loops.into_values().collect()
    }

    /// Returns, by node, whether it lies on a cycle.
    #[must_use]
    pub fn in_loops(&self, sources: &Adjacency) -> Vec<bool> {
        let on_circle = |(node, sources): (usize, &[usize])| {
            sources.iter().any(|source| self.same(node, *source))
        };
        sources.rows().map(on_circle).collect()
    }
}

impl Search<'_> {
    // The indices are nodes below `count`, the length of every array here.
    fn from(&mut self, root: usize) {
        self.path.push((root, 0));
        self.enter(root);
        while let Some((node, next)) = self.path.last_mut() {
            let node = *node;
            if let Some(&source) = self.sources.of(node).get(*next) {
                *next += 1;
                if self.order[source] == NEW {
                    self.enter(source);
                    self.path.push((source, 0));
                } else if self.on_stack[source] {
                    self.low[node] = self.low[node].min(self.order[source]);
                }
                continue;
            }
            self.path.pop();
            if let Some((parent, _)) = self.path.last() {
                self.low[*parent] = self.low[*parent].min(self.low[node]);
            }
            if self.low[node] == self.order[node] {
                self.close(node);
            }
        }
    }

    fn enter(&mut self, node: usize) {
        self.order[node] = self.visited;
        self.low[node] = self.visited;
        self.visited += 1;
        self.stack.push(node);
        self.on_stack[node] = true;
    }

    fn close(&mut self, node: usize) {
        while let Some(member) = self.stack.pop() {
            self.on_stack[member] = false;
            self.of[member] = self.components;
            if member == node {
                break;
            }
        }
        self.components += 1;
    }
}

/// Returns a shortest cycle through the first node of a component that is a loop, in the direction from source to
/// reader.
#[must_use]
pub fn circle(sources: &Adjacency, component: &[usize]) -> Vec<usize> {
    let Some(&first) = component.first() else {
        return Vec::new();
    };
    // Walks from the first node back to its sources; `towards` leads forward again.
    let mut towards: BTreeMap<usize, usize> = BTreeMap::new();
    let mut queue = VecDeque::from([first]);
    while let Some(node) = queue.pop_front() {
        for &source in sources.of(node) {
            if source == first {
                let mut path = vec![first];
                let mut at = node;
                while at != first {
                    path.push(at);
                    at = towards.get(&at).copied().unwrap_or(first);
                }
                return path;
            }
            if component.binary_search(&source).is_ok() && !towards.contains_key(&source) {
                towards.insert(source, node);
                queue.push_back(source);
            }
        }
    }
    Vec::new()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cycles_are_found_in_the_direction_of_values() {
        // 0 reads 2, 1 reads 0, 2 reads 1; 3 reads 0; 4 reads itself.
        let sources: Adjacency = [[2], [0], [1], [0], [4]].into_iter().collect();
        let components = Components::of(&sources);
        let loops = components.loops(&sources);
        assert_eq!(loops.len(), 2);
        assert!(loops.contains(&vec![0, 1, 2]) && loops.contains(&vec![4]));
        assert_eq!(circle(&sources, &[0, 1, 2]), [0, 1, 2]);
        assert_eq!(circle(&sources, &[4]), [4]);
        assert!(!components.same(0, 3));
    }

    #[test]
    fn a_long_chain_needs_no_deep_stack() {
        let count = 300_000;
        let chain = |first: Option<usize>| -> Adjacency {
            let before = (0..count).map(|node: usize| node.checked_sub(1));
            before.map(|before| before.or(first)).collect()
        };
        let sources = chain(None);
        assert!(Components::of(&sources).loops(&sources).is_empty());
        let sources = chain(Some(count - 1));
        let loops = Components::of(&sources).loops(&sources);
        assert_eq!(loops[0].len(), count);
        assert_eq!(circle(&sources, &loops[0]).len(), count);
    }
}
