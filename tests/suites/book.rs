//! The documentation holds together: the book has every page, and links, anchors and file names lead somewhere.
//! Run by the threads of the test harness; mdBook is not needed.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use rcc_tests::repository;

/// Pages at the root of the repository, beside those in `docs/`.
const ROOT_PAGES: [&str; 4] = [
    "README.md",
    "ARCHITECTURE.md",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
];
/// Folders and files at the root, by which a name in backticks is recognised as a path.
const ROOTS: [&str; 12] = [
    "rcc-core/",
    "rcc-exec/",
    "rcc-loader/",
    "rcc-drivers/",
    "rcc-monitor/",
    "rcc-cli/",
    "tests/",
    "bench/",
    "fuzz/",
    "docs/",
    "configs/",
    ".ci/",
];
/// Maximum number of lines of the README: its readers have not decided yet whether to read on.
const README_LINES_MAX: usize = 150;

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Returns the names of all Markdown files in `docs/`, sorted.
fn doc_pages() -> Vec<String> {
    let entries = fs::read_dir(repository().join("docs")).expect("the docs");
    let names = entries.map(|entry| entry.expect("an entry").file_name());
    let names = names.map(|name| name.to_string_lossy().into_owned());
    let mut names: Vec<String> = names.filter(|name| name.ends_with(".md")).collect();
    names.sort();
    names
}

/// Returns the paths of all pages whose links are checked.
fn pages() -> Vec<PathBuf> {
    let docs = doc_pages().into_iter().map(|name| format!("docs/{name}"));
    let root = ROOT_PAGES.into_iter().map(str::to_owned);
    root.chain(docs)
        .map(|page| repository().join(page))
        .collect()
}

/// Returns a page's lines outside of fenced code blocks.
fn prose(text: &str) -> Vec<&str> {
    let mut fenced = false;
    let outside = text.lines().filter(|line| {
        let fence = line.trim_start().starts_with("```");
        fenced ^= fence;
        !fenced && !fence
    });
    outside.collect()
}

/// Returns a line without its code spans.
fn without_code(line: &str) -> String {
    line.split('`').step_by(2).collect()
}

/// Returns the targets of all links and pictures of a page, `](TARGET)`.
fn links(text: &str) -> Vec<String> {
    let mut targets = Vec::new();
    for line in prose(text) {
        let line = without_code(line);
        for part in line.split("](").skip(1) {
            targets.extend(part.split(')').next().map(str::to_owned));
        }
    }
    targets
}

/// Returns the anchors of a page's headings, as GitHub and mdBook make them.
fn anchors(text: &str) -> Vec<String> {
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    let mut anchors = Vec::new();
    for line in prose(text) {
        let title = line.trim_start_matches('#');
        if title.len() == line.len() || !title.starts_with(' ') {
            continue;
        }
        let kept = title.trim().to_lowercase();
        let kept = kept
            .chars()
            .filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
        let slug: String = kept.map(|c| if c == ' ' { '-' } else { c }).collect();
        let count = seen.entry(slug.clone()).or_default();
        anchors.push(match *count {
            0 => slug,
            nth => format!("{slug}-{nth}"),
        });
        *count += 1;
    }
    anchors
}

#[test]
fn the_book_has_every_page_of_the_docs_exactly_once() {
    let summary = read(&repository().join("docs/SUMMARY.md"));
    let mut chapters = links(&summary);
    chapters.sort();
    let mut pages = doc_pages();
    pages.retain(|name| name != "SUMMARY.md");
    assert_eq!(
        chapters, pages,
        "docs/SUMMARY.md against the files in docs/"
    );
    let config = read(&repository().join("book.toml"));
    assert!(config.contains("src = \"docs\""), "{config}");
}

#[test]
fn every_relative_link_and_anchor_leads_somewhere() {
    let mut dead = Vec::new();
    let mut count = 0;
    for page in pages() {
        let text = read(&page);
        for link in links(&text) {
            if link.contains("://") || link.starts_with("mailto:") {
                continue;
            }
            count += 1;
            let (file, anchor) = match link.split_once('#') {
                Some((file, anchor)) => (file, Some(anchor)),
                None => (link.as_str(), None),
            };
            let folder = page.parent().expect("a folder");
            let target = match file {
                "" => page.clone(),
                file => folder.join(file),
            };
            let found = match anchor {
                None => target.exists(),
                Some(anchor) => {
                    target.is_file() && anchors(&read(&target)).iter().any(|is| is == anchor)
                }
            };
            if !found {
                dead.push(format!("{}: {link}", page.display()));
            }
        }
    }
    assert!(dead.is_empty(), "{dead:#?}");
    assert!(count > 100, "{count} links");
}

#[test]
fn every_file_that_the_pages_at_the_root_name_exists() {
    let mut missing = Vec::new();
    let mut count = 0;
    for page in ROOT_PAGES {
        let text = read(&repository().join(page));
        for line in prose(&text) {
            for span in line.split('`').skip(1).step_by(2) {
                let path = span.trim_end_matches('/');
                let named = ROOTS.iter().any(|root| span.starts_with(root));
                if !named
                    || path.contains([' ', '*', '<', '{', '…', '$', '='])
                    || path.contains("NAME")
                    || path.contains("nnnn")
                {
                    continue;
                }
                count += 1;
                if !repository().join(path).exists() {
                    missing.push(format!("{page}: {span}"));
                }
            }
        }
    }
    assert!(missing.is_empty(), "{missing:#?}");
    assert!(count > 50, "{count} paths");
}

#[test]
fn the_readme_is_short() {
    let lines = read(&repository().join("README.md")).lines().count();
    assert!(lines <= README_LINES_MAX, "{lines} lines");
}
