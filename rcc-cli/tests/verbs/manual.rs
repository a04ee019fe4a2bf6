//! Manual pages and completions know every verb.

use std::fs;

use clap::CommandFactory;
use rcc_cli::arguments::Arguments;

use crate::program::run_to;

fn verbs() -> Vec<String> {
    let all = Arguments::command();
    let verbs = all.get_subcommands().map(|verb| verb.get_name().to_owned());
    verbs.collect()
}

#[test]
fn every_verb_has_a_manual_page() {
    let temporary = rcc_testing::folder();
    let folder = temporary.path().join("new");
    run_to(0, &["man", &folder.display().to_string()]);
    let main = fs::read_to_string(folder.join("rcc-cli.1")).expect("the main page");
    let pages: Vec<(String, bool)> = verbs()
        .into_iter()
        .map(|verb| {
            let page = fs::read_to_string(folder.join(format!("rcc-cli-{verb}.1")));
            let named = main.contains(&format!("rcc\\-cli\\-{}(1)", verb.replace('-', "\\-")));
            (
                verb,
                named && page.is_ok_and(|page| page.contains("SYNOPSIS")),
            )
        })
        .collect();
    assert!(pages.len() > 30, "{pages:?}");
    let missing: Vec<_> = pages.iter().filter(|(_, complete)| !complete).collect();
    assert!(missing.is_empty(), "{missing:?}");
}

#[test]
fn completions_know_every_verb() {
    for shell in ["bash", "zsh", "fish"] {
        let (text, _) = run_to(0, &["completions", shell]);
        for verb in verbs() {
            assert!(text.contains(&verb), "{shell}: {verb}");
        }
    }
}
