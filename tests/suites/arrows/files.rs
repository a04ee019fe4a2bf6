//! No cyclic dependencies between the source files of a package, except between a file and its own modules; what two
//! files need is in a third.
//!
//! Read from the text: all paths that begin with `crate`, `super` or `self`, followed through re-exports. Run by the
//! threads of the test harness.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fs;
use std::path::{Path, PathBuf};

use rcc_tests::cell_fixture::files_below;
use rcc_tests::repository;

/// Place in a package, by names: a module `["frame", "slot"]`, or what is in it.
type Place = Vec<String>;

/// Longest chain of re-exports that is followed.
const REEXPORTS_MAX: usize = 8;

/// Returns the folders `src` below a folder.
fn sources_below(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).expect("a folder").flatten() {
        let (path, name) = (entry.path(), entry.file_name());
        match name.to_str() {
            Some("src") => found.push(path),
            Some("target") | None => {}
            Some(name) if name.starts_with('.') => {}
            Some(_) if path.is_dir() => found.extend(sources_below(&path)),
            Some(_) => {}
        }
    }
    found
}

/// Returns the code of a file: without comments, and without its inline tests.
fn code(text: &str) -> String {
    let before = text.split("#[cfg(test)]\nmod tests {").next();
    let lines = before.unwrap_or_default().lines();
    let code = lines.map(|line| line.split("//").next().unwrap_or_default());
    code.collect::<Vec<_>>().join("\n")
}

/// Reads a tree of paths, `a::{b, c::d as e}`, and adds each path with the name that it gives; returns the text behind it.
fn tree<'t>(mut text: &'t str, mut path: Place, found: &mut Vec<(Place, String)>) -> &'t str {
    loop {
        text = text.trim_start();
        if let Some(list) = text.strip_prefix('{') {
            text = list.trim_start();
            while !text.is_empty() && !text.starts_with('}') {
                let behind = tree(text, path.clone(), found);
                let next = behind.find([',', '}']).unwrap_or(behind.len());
                text = behind[next..].trim_start_matches(',').trim_start();
            }
            return text.strip_prefix('}').unwrap_or(text);
        }
        let end = text.find(|letter: char| !letter.is_alphanumeric() && letter != '_');
        let (name, behind) = text.split_at(end.unwrap_or(text.len()));
        if !name.is_empty() && (name != "self" || path.is_empty()) {
            path.push(name.to_owned());
        }
        match behind.trim_start().strip_prefix("::") {
            Some(rest) if !name.is_empty() => text = rest,
            _ => {
                let alias = behind.trim_start().strip_prefix("as ");
                let alias = alias.and_then(|alias| alias.split([',', ';', '}']).next());
                let given = alias.map(|alias| alias.trim().to_owned());
                let given = given.or(path.last().cloned()).unwrap_or_default();
                found.push((path, given));
                return behind;
            }
        }
    }
}

/// Returns all paths in a code that begin at the package or at a module.
fn named(code: &str) -> Vec<Place> {
    let mut found = Vec::new();
    let mut rest = code;
    let root = |rest: &str| {
        let roots = ["crate::", "super::", "self::"];
        roots.iter().filter_map(|root| rest.find(root)).min()
    };
    while let Some(at) = root(rest) {
        rest = tree(&rest[at..], Place::new(), &mut found);
    }
    found.into_iter().map(|(path, _)| path).collect()
}

/// Returns the paths that a code re-exports, with their names.
fn reexported(code: &str) -> Vec<(Place, String)> {
    let mut found = Vec::new();
    for (at, keyword) in code.match_indices("use ") {
        let line = code[..at].rsplit('\n').next().unwrap_or_default();
        if line.trim_start().starts_with("pub") {
            tree(&code[at + keyword.len()..], Place::new(), &mut found);
        }
    }
    found
}

/// The source files of a package, by module.
#[derive(Default)]
struct Package {
    code: BTreeMap<Place, String>,
    /// The targets of re-exports, by name of the module.
    reexports: BTreeMap<Place, Place>,
}

impl Package {
    /// Reads the files below a folder `src`; without those of tests.
    fn read(source: &Path) -> Package {
        let files = files_below(source).into_iter().filter_map(|path| {
            let relative = path.strip_prefix(source).ok()?.with_extension("");
            let mut module: Place = relative
                .iter()
                .map(|name| name.to_str().map(str::to_owned))
                .collect::<Option<_>>()?;
            let is_test = module.iter().any(|name| name == "tests");
            if is_test || path.extension()? != "rs" {
                return None;
            }
            module.pop_if(|name| ["lib", "main", "mod"].contains(&name.as_str()));
            Some((module, fs::read_to_string(&path).expect("a source file")))
        });
        Package::of(files)
    }

    fn of(files: impl IntoIterator<Item = (Place, String)>) -> Package {
        let mut package = Package::default();
        for (module, text) in files {
            // `lib.rs` and `main.rs` are both the root.
            *package.code.entry(module).or_default() += &code(&text);
        }
        for (module, code) in &package.code {
            for (path, name) in reexported(code) {
                let name = [module.as_slice(), &[name]].concat();
                package.reexports.insert(name, absolute(module, &path));
            }
        }
        package
    }

    /// Returns the modules of the files that a path of a module needs: where it leads, also through re-exports.
    fn needed(&self, module: &Place, path: &Place) -> Vec<Place> {
        let mut place = absolute(module, path);
        let mut found = Vec::new();
        for _ in 0..REEXPORTS_MAX {
            let lengths = (0..=place.len()).rev();
            let known = lengths
                .into_iter()
                .find(|length| self.code.contains_key(&place[..*length]));
            let Some(length) = known else { break };
            found.push(place[..length].to_vec());
            let name = place.get(..=length);
            let Some(target) = name.and_then(|name| self.reexports.get(name)) else {
                break;
            };
            place = [target.as_slice(), &place[length + 1..]].concat();
        }
        found
    }

    /// Returns the other files that each file needs, but for its own modules and those whose own it is.
    fn arrows<'p>(&'p self) -> BTreeMap<&'p Place, BTreeSet<Place>> {
        let row = |(module, code): (&'p Place, &String)| {
            let paths = named(code).into_iter();
            let needed = paths.flat_map(|path| self.needed(module, &path));
            let other = |to: &Place| !to.starts_with(module) && !module.starts_with(to);
            (module, needed.filter(other).collect())
        };
        self.code.iter().map(row).collect()
    }

    /// Returns the circles, each once: a shortest one through the first of its files.
    fn circles(&self) -> Vec<Vec<String>> {
        let arrows = self.arrows();
        let mut circles = Vec::new();
        for start in self.code.keys() {
            let mut ways = VecDeque::from([vec![start]]);
            let mut seen = BTreeSet::new();
            while let Some(way) = ways.pop_front() {
                let last = way.last().copied().unwrap_or(start);
                if last == start && way.len() > 1 {
                    circles.push(way.iter().map(|module| module.join("::")).collect());
                    break;
                }
                // Circles through earlier files are found from there.
                let next = arrows
                    .get(last)
                    .into_iter()
                    .flatten()
                    .filter(|to| *to >= start);
                for to in next.filter(|to| seen.insert(*to)) {
                    ways.push_back([way.as_slice(), &[to]].concat());
                }
            }
        }
        circles
    }
}

/// Returns the place in the package that a path of a module means.
fn absolute(module: &Place, path: &Place) -> Place {
    let mut place = match path.first().map(String::as_str) {
        Some("crate") => Place::new(),
        _ => module.clone(),
    };
    for name in path {
        match name.as_str() {
            "crate" | "self" => {}
            "super" => drop(place.pop()),
            _ => place.push(name.clone()),
        }
    }
    place
}

#[test]
fn no_source_files_of_a_package_need_each_other() {
    let sources = sources_below(repository());
    assert!(sources.len() > 20, "the packages are found: {sources:?}");
    let mut found = String::new();
    for source in sources {
        for circle in Package::read(&source).circles() {
            let package = source
                .strip_prefix(repository())
                .expect("below the repository");
            found += &format!("{}: {}\n", package.display(), circle.join(" → "));
        }
    }
    assert!(
        found.is_empty(),
        "these files need each other: move what both need into a third one, or turn a call around\n{found}"
    );
}

/// The circles of a package with these files; `""` is its root.
fn circles(files: &[(&str, &str)]) -> Vec<String> {
    let files = files.iter().map(|(module, text)| {
        let names = module.split("::").filter(|name| !name.is_empty());
        (names.map(str::to_owned).collect(), (*text).to_owned())
    });
    let circles = Package::of(files).circles();
    circles.iter().map(|circle| circle.join(" ")).collect()
}

#[test]
fn a_circle_is_found_however_a_path_is_written() {
    let pairs = [
        ("use crate::b::B;", "use crate::a::A;"),
        (
            "use super::{\n    b::{self, B},\n    c as other,\n};",
            "fn f() { super::a::g(); }",
        ),
        (
            "type A = crate::b::B<u8>;",
            "pub use crate::{c, a::A as Other};",
        ),
    ];
    for (a, b) in pairs {
        assert_eq!(
            circles(&[("", "mod a; mod b;"), ("a", a), ("b", b), ("c", "")]),
            ["a b a"],
            "{a}"
        );
    }
    let long = [
        ("a", "use crate::b;"),
        ("b", "use crate::c::C;"),
        ("c", "use crate::a::A;"),
        ("d", "use crate::c;"),
    ];
    assert_eq!(circles(&long), ["a b c a"]);
}

#[test]
fn a_reexport_hides_no_circle() {
    let root = ("", "pub use a::{A, Other as Known};");
    assert_eq!(
        circles(&[root, ("a", "use crate::b::B;"), ("b", "use crate::A;")]),
        ["a b a"]
    );
    assert_eq!(
        circles(&[
            root,
            ("a", "use crate::b::B;"),
            ("b", "fn f(_: &crate::Known) {}")
        ]),
        ["a b a"]
    );
}

#[test]
fn modules_of_a_file_comments_and_inline_tests_make_no_circle() {
    assert_eq!(
        circles(&[
            ("a", "mod b; use b::B;"),
            ("a::b", "use super::A; use crate::a::C;")
        ]),
        [""; 0]
    );
    let a = ("a", "use crate::b::B;");
    assert_eq!(
        circles(&[a, ("b", "// use crate::a::A;\nfn f() {} // see crate::a")]),
        [""; 0]
    );
    assert_eq!(
        circles(&[
            a,
            (
                "b",
                "fn f() {}\n#[cfg(test)]\nmod tests {\n    use crate::a::A;\n}"
            )
        ]),
        [""; 0]
    );
}
