//! The net as a tree of text. Used by applications, never on a real-time thread.

use std::collections::HashSet;

use rcc_config::yaml::layout::{Tree, TreeBlock, TreeEntry};

use super::{BuildError, LinkSource, NetState, NodeState};

impl NetState {
    /// Returns the outputs that are read or discarded.
    pub(super) fn read(&self) -> HashSet<String> {
        let sources = self.nodes.iter().flat_map(|node| {
            let inputs = node.inputs.iter().map(|(_, source)| source);
            inputs.chain(&node.active)
        });
        let links = sources.filter_map(|source| match source {
            LinkSource::Output(name) => Some(name),
            LinkSource::Delayed(index) => self.delayed.get(*index)?.from.as_ref(),
            LinkSource::Constant(_) => None,
        });
        let whole = |name: &String| name.split('[').next().unwrap_or_default().to_string();
        links.chain(&self.discard).map(whole).collect()
    }

    pub(super) fn tree(&self) -> Result<Tree, BuildError> {
        let mut entries = vec![("net".to_string(), Tree::Text(self.name.clone()))];
        entries.extend(self.keys.iter().cloned());
        if !self.fragments.is_empty() {
            entries.push((
                "fragments".to_string(),
                Tree::map(self.fragments.iter().cloned()),
            ));
        }
        entries.extend(self.body()?);
        Ok(Tree::map(entries))
    }

    /// Returns `primitives` and `discard` of a net or a fragment.
    pub(crate) fn body(&self) -> Result<Vec<(String, Tree)>, BuildError> {
        if let Some(mistake) = &self.mistake {
            return Err(mistake.clone());
        }
        let mut entries = Vec::new();
        for node in &self.nodes {
            entries.push(TreeEntry::new(node.id.as_str(), self.node_tree(node)?));
        }
        let primitives = Tree::Map(TreeBlock {
            open: true,
            ..TreeBlock::new(entries)
        });
        let mut body = vec![("primitives".to_string(), primitives)];
        if !self.discard.is_empty() {
            let outputs = self.discard.iter().map(|name| Tree::Text(name.clone()));
            body.push(("discard".to_string(), Tree::list(outputs)));
        }
        Ok(body)
    }

    fn node_tree(&self, node: &NodeState) -> Result<Tree, BuildError> {
        let mut entries = vec![(node.kind.to_string(), Tree::Text(node.type_name.clone()))];
        if !node.parameters.is_empty() {
            entries.push((
                "parameters".to_string(),
                Tree::map(node.parameters.iter().cloned()),
            ));
        }
        let mut inputs = Vec::new();
        for (input, source) in &node.inputs {
            inputs.push((input.clone(), self.source_tree(node, input, source)?));
        }
        if !inputs.is_empty() {
            entries.push(("inputs".to_string(), Tree::map(inputs)));
        }
        if let Some(active) = &node.active {
            entries.push((
                "active".to_string(),
                self.source_tree(node, "active", active)?,
            ));
        }
        Ok(Tree::map(entries))
    }

    fn source_tree(
        &self,
        node: &NodeState,
        input: &str,
        source: &LinkSource,
    ) -> Result<Tree, BuildError> {
        let index = match source {
            LinkSource::Output(name) => return Ok(Tree::Text(name.clone())),
            LinkSource::Constant(tree) => return Ok(tree.clone()),
            LinkSource::Delayed(index) => *index,
        };
        let delayed = self.delayed.get(index);
        let Some((delayed, from)) =
            delayed.and_then(|delayed| Some((delayed, delayed.from.as_ref()?)))
        else {
            return Err(BuildError::NeverFed {
                primitive: node.id.clone(),
                input: input.to_string(),
            });
        };
        let mut entries = vec![
            ("from".to_string(), Tree::Text(from.clone())),
            ("delayed".to_string(), Tree::Plain("true".to_string())),
        ];
        entries.extend(
            delayed
                .initial
                .clone()
                .map(|initial| ("initial".to_string(), initial)),
        );
        Ok(Tree::map(entries))
    }
}
