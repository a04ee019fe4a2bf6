//! Nets to load, by size, in each notation that the loader reads. Any thread.

use rcc_language::parse::parse;
use rcc_language::write;

use crate::graph::{Graph, LoadError};
use crate::instance::cell;
use crate::net::net;

/// The notations: name, and the text of a net with this number of nodes, one of [`crate::graph::SIZES`].
pub const NOTATIONS: [(&str, TextOf); 3] =
    [("json", json), ("yaml", yaml), ("directionet", foreign)];
/// Returns the text of a net.
pub type TextOf = fn(usize) -> Result<String, LoadError>;

fn json(size: usize) -> Result<String, LoadError> {
    Ok(net(&Graph::load("full", size)?).text)
}

/// The same net as in JSON, as `rcc-cli fmt` writes it.
fn yaml(size: usize) -> Result<String, LoadError> {
    let net = parse(&json(size)?, "graph.json", &cell(), &[], &mut Vec::new());
    Ok(net.map_or_else(String::new, |net| write::yaml(&net)))
}

/// A net of the predecessor: sums of two sums before them, of which a comparison ends the net.
fn foreign(size: usize) -> Result<String, LoadError> {
    let sums = (2..size.max(4) - 2).map(|number| {
        let (a, b) = (number - 1, number / 2);
        format!("n{number}=Core::DoubleAdd(inFirst=n{a}.outValue,inSecond=n{b}.outValue)")
    });
    let sums: Vec<String> = sums.collect();
    let last = size.max(4) - 3;
    Ok(format!(
        "{{n0=Core::DoubleValue(Value='1.5'),n1=Core::DoubleValue(Value='0.25'),{},\
         far=Core::DoubleGreater(inFirst=n{last}.outValue,inSecond=n0.outValue),outTerminate=far.outValue}}",
        sums.join(",")
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::SIZES;
    use rcc_directionet::compiler;

    #[test]
    fn every_text_compiles_to_a_net_of_its_size() {
        let (cell, size) = (cell(), SIZES[0]);
        for (name, text) in NOTATIONS {
            let compiled = compiler(&cell).compile(&text(size).unwrap(), name);
            let compiled = compiled.unwrap_or_else(|faults| panic!("{name}: {faults}"));
            let count = compiled.names.primitives.len();
            assert!(
                (size * 9 / 10..size * 2).contains(&count),
                "{name}: {count}"
            );
        }
    }
}
