//! Every net in the repository, example nets and those in the documents, has the layout of `rcc-cli fmt`. `RCC_BLESS=1`
//! formats them. A net in a document is a YAML block with a line `net:` and a line `primitives:`.

use std::fs;
use std::path::{Path, PathBuf};

use rcc_language::format::format;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn files(folder: &str, end: &str, found: &mut Vec<PathBuf>) {
    let Ok(entries) = fs::read_dir(root().join(folder)) else {
        return;
    };
    for file in entries {
        let path = file.unwrap().path();
        if path.is_dir() {
            let name = path.file_name().unwrap().to_string_lossy();
            files(&format!("{folder}/{name}"), end, found);
        } else if path.extension().is_some_and(|extension| extension == end) {
            found.push(path);
        }
    }
}

fn is_laid_out(text: &str, name: &str) {
    let written = format(text, name).unwrap_or_else(|error| panic!("{name}: {error:?}"));
    assert_eq!(written, text, "{name}: not formatted (run `rcc-cli fmt`)");
}

fn bless() -> bool {
    std::env::var_os("RCC_BLESS").is_some()
}

#[test]
fn example_nets_are_laid_out() {
    let mut nets = Vec::new();
    files("configs/nets", "yaml", &mut nets);
    files("tests/nets/ok", "yaml", &mut nets);
    assert!(nets.len() >= 10);
    for net in nets {
        let (text, name) = (fs::read_to_string(&net).unwrap(), net.display().to_string());
        if bless() {
            fs::write(&net, format(&text, &name).unwrap()).unwrap();
        } else {
            is_laid_out(&text, &name);
        }
    }
}

#[test]
fn nets_in_documents_are_laid_out() {
    let mut documents = Vec::new();
    files("docs", "md", &mut documents);
    let mut count = 0;
    for document in documents {
        let name = document.display().to_string();
        let mut text = fs::read_to_string(&document).unwrap();
        for block in text.clone().split("\n```yaml\n").skip(1) {
            let block = block.split("```").next().unwrap();
            let is = |key: &str| block.lines().any(|line| line.starts_with(key));
            if !(is("net: ") && is("primitives:")) {
                continue;
            }
            count += 1;
            if bless() {
                text = text.replace(block, &format(block, &name).unwrap());
            } else {
                is_laid_out(block, &name);
            }
        }
        if bless() {
            fs::write(&document, text).unwrap();
        }
    }
    assert!(count >= 1, "{count}");
}
