//! The order of the house: which folder imports which, no circles of imports, nothing too long, nothing left to do, and every folder
//! in ARCHITECTURE.md. What may import what is declared in `tests/tidy/imports.txt`; circles that are not yet broken are in
//! `tests/tidy/circles.txt`.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Where each crate's files are.
const CRATES: [&str; 3] = ["kernels/src", "codegen/src", "src"];
/// Most lines of a file.
const MOST_LINES: usize = 700;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).to_owned()
}

/// All files below a folder, with their paths from the repository's root.
fn files(folder: &str) -> Vec<String> {
    let mut out = Vec::new();
    for entry in fs::read_dir(root().join(folder)).unwrap().map(Result::unwrap) {
        let path = format!("{folder}/{}", entry.file_name().to_string_lossy());
        if entry.path().is_dir() {
            out.extend(files(&path));
        } else {
            out.push(path);
        }
    }
    out.sort();
    out
}

fn read(path: &str) -> String {
    fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// All Rust and Python files that are written by hand.
fn sources() -> Vec<String> {
    let folders =
        ["kernels", "codegen", "src", "tests", "benches", "examples", "python/src", "python/lanesim", "python/tests"];
    let written = |path: &String| path.ends_with(".rs") || path.ends_with(".py");
    folders.into_iter().flat_map(files).filter(|path| written(path) && !path.contains("/target/")).collect()
}

/// What imports say: without comments, texts, and tests at the end.
fn code(text: &str) -> String {
    let text = text.split("#[cfg(test)]").next().unwrap_or_default();
    let (mut out, mut rest) = (String::new(), text);
    while let Some(c) = rest.chars().next() {
        if rest.starts_with("//") {
            rest = &rest[rest.find('\n').unwrap_or(rest.len())..];
        } else if c == '"' {
            let mut escaped = true;
            let end = rest.find(|c| {
                let ends = c == '"' && !escaped;
                escaped = c == '\\' && !escaped;
                ends
            });
            rest = &rest[end.map_or(rest.len(), |end| end + 1)..];
        } else if rest.starts_with("'\"'") {
            rest = &rest[3..];
        } else {
            out.push(c);
            rest = &rest[c.len_utf8()..];
        }
    }
    out
}

/// The paths of a tree of imports.
fn paths(tree: &str) -> Vec<String> {
    let Some((before, rest)) = tree.split_once('{') else { return vec![tree.to_owned()] };
    let inside = &rest[..rest.rfind('}').unwrap_or(rest.len())];
    let (mut out, mut depth, mut start) = (Vec::new(), 0, 0);
    for (i, c) in inside.char_indices().chain([(inside.len(), ',')]) {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                out.extend(paths(inside[start..i].trim()).into_iter().map(|path| format!("{before}{path}")));
                start = i + 1;
            }
            _ => {}
        }
    }
    out
}

/// All paths that begin in the crate, as their parts.
fn imports(text: &str) -> Vec<Vec<String>> {
    let code = code(text);
    let mut found = Vec::new();
    for piece in code.split(';') {
        let Some(place) = piece.rfind("use ") else { continue };
        if piece[..place].chars().next_back().is_none_or(|c| c.is_whitespace()) {
            let tree: String = piece[place + 4..].split(" as ").next().unwrap_or_default().into();
            found.extend(paths(&tree.chars().filter(|c| !c.is_whitespace()).collect::<String>()));
        }
    }
    for start in ["crate::", "super::"] {
        for (place, _) in code.match_indices(start) {
            let is_part = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
            if !code[..place].ends_with(is_part) {
                found.push(code[place..].chars().take_while(|c| is_part(*c)).collect());
            }
        }
    }
    found.iter().map(|path| path.split("::").map(str::to_owned).collect()).collect()
}

type Module = Vec<String>;

/// Which modules of a crate import which.
fn graph(folder: &str) -> BTreeMap<Module, BTreeSet<Module>> {
    let module = |path: &String| -> Option<(Module, String)> {
        let inside = path.strip_prefix(folder)?.strip_prefix('/')?.strip_suffix(".rs")?;
        let mut parts: Module = inside.split('/').map(str::to_owned).collect();
        if matches!(parts.last().map(String::as_str), Some("mod" | "lib")) {
            parts.pop();
        }
        (parts != ["main"]).then(|| (parts, path.clone()))
    };
    let modules: BTreeMap<Module, String> = files(folder).iter().filter_map(module).collect();
    let known = |mut path: Module| {
        while !modules.contains_key(&path) {
            path.pop()?;
        }
        Some(path)
    };
    let of = |(module, path): (&Module, &String)| {
        let mut out = BTreeSet::new();
        for mut parts in imports(&read(path)) {
            let mut from = if parts[0] == "crate" { Module::new() } else { module.clone() };
            if !["crate", "super", "self"].contains(&parts[0].as_str()) {
                continue;
            }
            while parts.first().is_some_and(|part| part == "super") {
                from.pop();
                parts.remove(0);
            }
            if parts.first().is_some_and(|part| part == "crate" || part == "self") {
                parts.remove(0);
            }
            out.extend(known(from.into_iter().chain(parts).collect()));
        }
        out.remove(module);
        (module.clone(), out)
    };
    modules.iter().map(of).collect()
}

/// Lines of a list, without comments.
fn list(path: &str) -> Vec<String> {
    read(path)
        .lines()
        .map(str::trim)
        .filter(|line| !line.is_empty() && !line.starts_with('#'))
        .map(str::to_owned)
        .collect()
}

#[test]
fn folders_import_what_is_declared() {
    let declared: BTreeMap<String, BTreeSet<String>> = list("tests/tidy/imports.txt")
        .iter()
        .map(|line| line.split_once(':').unwrap_or_else(|| panic!("no colon: {line}")))
        .map(|(folder, may)| (folder.to_owned(), may.split_ascii_whitespace().map(str::to_owned).collect()))
        .collect();
    let mut wrong = Vec::new();
    for folder in CRATES {
        let mut found = BTreeMap::<String, BTreeSet<String>>::new();
        for (module, imported) in graph(folder).into_iter().filter(|(module, _)| !module.is_empty()) {
            let tops = imported.into_iter().filter(|other| !other.is_empty() && other[0] != module[0]);
            found.entry(format!("{folder}/{}", module[0])).or_default().extend(tops.map(|other| other[0].clone()));
        }
        for (top, imported) in found {
            let may = declared.get(&top).cloned().unwrap_or_default();
            let more: Vec<&String> = imported.difference(&may).collect();
            if !more.is_empty() {
                wrong.push(format!("{top} imports {more:?}: it should not, or tests/tidy/imports.txt has to say so"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Modules from which a module can be reached, and which it reaches: those that are in a circle with it.
fn circles(graph: &BTreeMap<Module, BTreeSet<Module>>) -> BTreeSet<BTreeSet<Module>> {
    let related = |a: &Module, b: &Module| a.starts_with(b) || b.starts_with(a);
    let reach = |start: &Module| {
        let (mut found, mut open) = (BTreeSet::new(), vec![start.clone()]);
        while let Some(module) = open.pop() {
            for next in graph[&module].iter().filter(|next| !related(&module, next)) {
                if found.insert(next.clone()) {
                    open.push(next.clone());
                }
            }
        }
        found
    };
    let reached: BTreeMap<&Module, BTreeSet<Module>> = graph.keys().map(|module| (module, reach(module))).collect();
    let circle = |module: &&Module| -> BTreeSet<Module> {
        let back = reached[*module].iter().filter(|other| reached[other].contains(*module));
        back.cloned().collect()
    };
    reached.keys().map(circle).filter(|circle| circle.len() > 1).collect()
}

#[test]
fn no_circle_of_imports() {
    let known: Vec<BTreeSet<String>> = list("tests/tidy/circles.txt")
        .iter()
        .map(|line| line.split_ascii_whitespace().map(str::to_owned).collect())
        .collect();
    let (mut wrong, mut found) = (Vec::new(), Vec::new());
    for folder in CRATES {
        for circle in circles(&graph(folder)) {
            let names: BTreeSet<String> =
                circle.iter().map(|module| format!("{folder}/{}", module.join("/"))).collect();
            if !known.iter().any(|known| names.is_subset(known)) {
                wrong.push(names.iter().cloned().collect::<Vec<_>>().join(" "));
            }
            found.push(names);
        }
    }
    assert!(wrong.is_empty(), "files that import each other in a circle:\n{}", wrong.join("\n"));
    let broken: Vec<_> = known.iter().filter(|known| !found.contains(known)).collect();
    assert!(broken.is_empty(), "no longer circles as they are listed: {broken:?}");
}

#[test]
fn every_folder_is_in_the_architecture() {
    let text = read("ARCHITECTURE.md");
    let mut folders = BTreeSet::new();
    for file in CRATES.into_iter().flat_map(files) {
        let parts: Vec<&str> = file.split('/').collect();
        let (prefix, depth) = if parts[0] == "src" { ("src", 1) } else { (&*format!("{}/src", parts[0]), 2) };
        if parts.len() > depth + 1 {
            folders.insert(format!("{prefix}/{}/", parts[depth]));
        }
    }
    // The stages and the parts of code generation have a line together.
    let missing: Vec<String> = folders
        .into_iter()
        .filter(|folder| {
            !text.contains(folder) && !text.contains(&format!("`{}/`", folder.split('/').rev().nth(1).unwrap()))
        })
        .collect();
    assert!(missing.is_empty(), "ARCHITECTURE.md says nothing of {missing:?}");
}

#[test]
fn nothing_is_too_long_or_left_to_do() {
    let mut wrong = Vec::new();
    // Written so that this file does not find itself.
    let left = [concat!("TO", "DO"), concat!("FIX", "ME"), concat!("#[ig", "nore")];
    for path in sources() {
        let text = read(&path);
        let lines = text.lines().count();
        if lines > MOST_LINES {
            wrong.push(format!("{path} has {lines} lines, more than {MOST_LINES}"));
        }
        wrong.extend(left.iter().filter(|word| text.contains(**word)).map(|word| format!("{path} has {word}")));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The test would see what it looks for.
#[test]
fn imports_are_found() {
    let text = "use crate::a::{b, c::{D, E}};\n// use crate::z::Z;\npub(crate) use super::f;\nfn g() { crate::h::i(); let _ = \"crate::no\"; }";
    let found: Vec<String> = imports(text).iter().map(|path| path.join("::")).collect();
    for path in ["crate::a::b", "crate::a::c::D", "crate::a::c::E", "super::f", "crate::h::i"] {
        assert!(found.iter().any(|other| other == path), "{path}: {found:?}");
    }
    assert!(!found.iter().any(|path| path.contains("z::") || path.contains("no")), "{found:?}");
    let module = |name: &str| vec![name.to_owned()];
    let edges = |names: &[&str]| names.iter().map(|name| module(name)).collect();
    let ring =
        BTreeMap::from([(module("a"), edges(&["b"])), (module("b"), edges(&["c"])), (module("c"), edges(&["a"]))]);
    assert_eq!(circles(&ring).len(), 1);
    let line = BTreeMap::from([(module("a"), edges(&["b"])), (module("b"), edges(&["c"])), (module("c"), edges(&[]))]);
    assert_eq!(circles(&line).len(), 0);
}
