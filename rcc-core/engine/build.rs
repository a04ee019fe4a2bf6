//! Computes the build id under which measured costs are stored: a hash (FNV-1a, 64 bits) of the sources that run in the
//! cycle, and of the optimisation settings. Costs measured with another build are measured again.

#[path = "../src/fnv.rs"]
mod fnv;

use std::path::{Path, PathBuf};
use std::{env, fs, io};

/// Folders with all sources that run in a cycle.
const SOURCES: [&str; 3] = ["../src", "../motion/src", "src"];

fn main() -> io::Result<()> {
    let mut hash = fnv::EMPTY;
    for name in ["PROFILE", "OPT_LEVEL", "DEBUG", "TARGET"] {
        hash = fnv::add(hash, env::var(name).unwrap_or_default().as_bytes());
    }
    for folder in SOURCES {
        println!("cargo:rerun-if-changed={folder}");
        for file in files(Path::new(folder))? {
            hash = fnv::add(hash, &fs::read(file)?);
        }
    }
    println!("cargo:rustc-env=RCC_BUILD={hash:016x}");
    Ok(())
}

/// All files in a folder and its subfolders, sorted.
fn files(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            found.extend(files(&path)?);
        } else {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}
