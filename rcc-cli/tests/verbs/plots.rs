//! The plots in docs/motions.md are what `rcc-cli plot` generates; `RCC_BLESS=1` regenerates them. Virtual time,
//! without a cell. Run by the threads of the test harness.

use std::fs;
use std::path::Path;

use crate::program::{repository, run_to};

/// Returns the commands of the page that generate a plot: `rcc-cli plot … -o docs/pictures/…`.
fn commands() -> Vec<Vec<String>> {
    let text = fs::read_to_string(repository().join("docs/motions.md")).expect("the page");
    let lines = text.lines();
    let commands = lines.filter_map(|line| line.strip_prefix("$ rcc-cli plot "));
    let words = commands.map(|line| line.split_whitespace().map(str::to_owned).collect());
    let makes = |words: &Vec<String>| words.iter().any(|word| word.starts_with("docs/pictures/"));
    words.filter(makes).collect()
}

#[test]
fn the_pictures_of_the_pages_are_what_plot_makes_now() {
    let bless = std::env::var_os("RCC_BLESS").is_some();
    let folder = rcc_testing::folder();
    let commands = commands();
    assert!(commands.len() >= 2, "{commands:?}");
    let mut changed = Vec::new();
    for words in commands {
        let picture = words
            .iter()
            .find(|word| word.starts_with("docs/pictures/"))
            .expect("one of them");
        let kept = repository().join(picture);
        let made = folder
            .path()
            .join(Path::new(picture).file_name().expect("a name"));
        let target = if bless { &kept } else { &made };
        let target = target.display().to_string();
        let words: Vec<&str> = words
            .iter()
            .map(|word| {
                if word == picture {
                    target.as_str()
                } else {
                    word
                }
            })
            .collect();
        run_to(0, &[&["plot"], words.as_slice()].concat());
        if !bless && fs::read(&made).ok() != fs::read(&kept).ok() {
            changed.push(picture.clone());
        }
    }
    assert!(
        changed.is_empty(),
        "look at them and make them anew with RCC_BLESS=1: {changed:?}"
    );
}
