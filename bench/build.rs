//! Translates the graphs of `graphs/` to plain Rust, which `src/straight.rs` includes; without the feature
//! `straight-line` to an empty table. Run by cargo before the package is compiled.

#[path = "build/straight.rs"]
mod straight;

use std::error::Error;
use std::fmt::Write;
use std::path::Path;
use std::{env, fs};

/// Mixes in which nothing ever becomes null; their programs also exist without null.
const NEVER_NULL: [&str; 2] = ["scalar", "mat"];

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=build");
    println!("cargo:rerun-if-changed=graphs");
    let (mut code, mut table) = (String::new(), String::new());
    let wanted = env::var_os("CARGO_FEATURE_STRAIGHT_LINE").is_some();
    for mix in ["scalar", "mat", "full"].into_iter().filter(|_| wanted) {
        for nodes in [50, 500, 2000, 10_000] {
            let name = format!("{mix}_{nodes}");
            let graph = serde_json::from_str(&fs::read_to_string(format!("graphs/{name}.json"))?)?;
            let variants: &[&str] = if NEVER_NULL.contains(&mix) {
                &["plain", "null"]
            } else {
                &["null"]
            };
            for variant in variants {
                straight::write(&mut code, &graph, &name, variant)?;
                writeln!(
                    table,
                    "    StraightLineProgram {{ graph: \"{name}\", null: {}, make: || Box::new({name}_{variant}::State::new()) }},",
                    *variant == "null"
                )?;
            }
        }
    }
    writeln!(
        code,
        "/// All programs.\npub const ALL: &[StraightLineProgram] = &[\n{table}];"
    )?;
    fs::write(Path::new(&env::var("OUT_DIR")?).join("straight.rs"), code)?;
    Ok(())
}
