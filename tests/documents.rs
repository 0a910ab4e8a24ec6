//! The documents against the tree: links, blocks of TOML, the book's pages, and what the architecture
//! names.

use pinc_tests::book::{self, root};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// A file; a page with its tables.
fn read(path: &Path) -> String {
    let text = match path.extension() {
        Some(ending) if ending == "md" => book::page(path),
        _ => fs::read_to_string(path).map_err(|error| format!("{}: {error}", path.display())),
    };
    text.unwrap_or_else(|problem| panic!("{problem}"))
}

/// What lies in a folder, sorted.
fn entries(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder);
    let entries = entries.unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut paths: Vec<_> = entries.map(|entry| entry.expect("a readable folder").path()).collect();
    paths.sort();
    paths
}

/// All files of a kind below a folder.
fn files(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let below = |path: PathBuf| match path.is_dir() {
        true => files(&path, extension),
        false => vec![path],
    };
    let of_kind = |path: &PathBuf| path.extension().is_some_and(|found| found == extension);
    entries(folder).into_iter().flat_map(below).filter(of_kind).collect()
}

/// A page without its blocks of code.
fn prose(page: &str) -> String {
    page.split("```").step_by(2).collect()
}

/// The targets of the links of a page.
fn links(page: &str) -> Vec<String> {
    let prose = prose(page);
    let targets = prose.split("](").skip(1).filter_map(|rest| rest.split(')').next());
    targets.map(str::to_owned).collect()
}

/// The anchors of a page's headings, as GitHub makes them.
fn anchors(page: &str) -> BTreeSet<String> {
    let prose = prose(page);
    let headings = prose.lines().filter(|line| line.starts_with('#'));
    let anchor = |line: &str| {
        let title = line.trim_start_matches('#').trim().to_lowercase();
        let kept = title.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
        kept.map(|c| if c == ' ' { '-' } else { c }).collect()
    };
    headings.map(anchor).collect()
}

/// The pages for readers: at the root, and in folders with their own.
fn pages() -> Vec<PathBuf> {
    let is_page = |path: &PathBuf| path.extension().is_some_and(|found| found == "md");
    let mut pages: Vec<_> = entries(&root()).into_iter().filter(is_page).collect();
    for folder in ["docs", "configs", "benches", "fuzz"] {
        pages.extend(files(&root().join(folder), "md"));
    }
    pages
}

/// What is wrong with a link of a page: none if file and heading are there.
fn fault(page: &Path, link: &str) -> Option<String> {
    let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
    let folder = page.parent().expect("a page is in a folder");
    let target = if file.is_empty() { page.to_path_buf() } else { folder.join(file) };
    if !target.exists() {
        return Some(format!("{}: {link} does not exist", page.display()));
    }
    let there = anchor.is_empty() || anchors(&read(&target)).contains(anchor);
    (!there).then(|| format!("{}: no heading for {link}", page.display()))
}

#[test]
fn links_lead_somewhere() {
    let (mut count, mut faults) = (0, Vec::new());
    for page in pages() {
        for link in links(&read(&page)).iter().filter(|link| !link.starts_with("http")) {
            count += 1;
            faults.extend(fault(&page, link));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    assert!(count > 300, "only {count} links found");
}

#[test]
fn a_broken_link_is_found() {
    let page = root().join("docs/introduction.md");
    for broken in ["no-such-page.md", "config.md#no-such-heading", "#no-such-heading"] {
        assert!(fault(&page, broken).is_some(), "{broken}");
    }
    for sound in ["config.md", "config.md#controlestimator", "../README.md", "#find-a-task"] {
        assert_eq!(fault(&page, sound), None);
    }
}

/// Macros of exported C begin with the name of the export, not with that of the templates.
#[test]
fn macros_of_exported_c_have_the_name_of_an_export() {
    for page in pages() {
        assert!(!read(&page).contains("-DPINC_"), "{}", page.display());
    }
}

#[test]
fn blocks_of_toml_can_be_read() {
    let mut count = 0;
    for page in pages() {
        let text = read(&page);
        for block in text.split("```toml\n").skip(1).filter_map(|rest| rest.split("```").next()) {
            count += 1;
            let read = block.parse::<toml::Table>();
            assert!(read.is_ok(), "{}: {read:?} in\n{block}", page.display());
        }
    }
    assert!(count >= 15, "only {count} blocks found");
}

/// Every page is in the table of contents, once, and nothing else is.
#[test]
fn the_book_has_every_page_once() {
    let summary = read(&root().join("docs/SUMMARY.md"));
    let mut listed = links(&summary);
    listed.sort();
    let name = |path: PathBuf| path.file_name().map(|name| name.to_string_lossy().into_owned());
    let mut there: Vec<_> =
        files(&root().join("docs"), "md").into_iter().filter_map(name).collect();
    there.retain(|name| name != "SUMMARY.md");
    there.sort();
    assert_eq!(listed, there);
}

/// The values of an attribute in a page of HTML.
fn attributes<'p>(html: &'p str, name: &str) -> BTreeSet<&'p str> {
    let start = format!(" {name}=\"");
    html.split(start.as_str()).skip(1).filter_map(|rest| rest.split('"').next()).collect()
}

/// `PINC_BOOK` names the folder of the built book, whose links are then followed (`.ci/book`).
#[test]
fn links_of_the_built_book_lead_somewhere() {
    let Some(folder) = std::env::var_os("PINC_BOOK").map(PathBuf::from) else { return };
    let is_page = |path: &PathBuf| path.extension().is_some_and(|found| found == "html");
    let pages: Vec<_> = entries(&folder).into_iter().filter(is_page).collect();
    assert!(pages.len() > 30, "{}: {} pages", folder.display(), pages.len());
    let mut faults = Vec::new();
    for page in pages {
        let html = read(&page);
        let links = ["href", "src"].into_iter().flat_map(|name| attributes(&html, name));
        for link in links.filter(|link| !link.contains(':') && !link.starts_with('/')) {
            let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target = if file.is_empty() { page.clone() } else { folder.join(file) };
            let is_in_book = !file.starts_with("..") && target.exists();
            let has_anchor = || attributes(&read(&target), "id").contains(anchor);
            if !is_in_book || !(anchor.is_empty() || has_anchor()) {
                faults.push(format!("{}: {link}", page.display()));
            }
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// The pieces of a text in backquotes.
fn quoted(text: &str) -> impl Iterator<Item = &str> {
    text.split('`').skip(1).step_by(2)
}

/// The part of a page below a heading, up to the next one of the same or a higher level.
fn section<'p>(page: &'p str, heading: &str) -> &'p str {
    let (_, rest) = page.split_once(&format!("\n{heading}\n")).unwrap_or_else(|| {
        panic!("no heading {heading}");
    });
    let level = heading.chars().take_while(|&c| c == '#').count();
    let ends = (1..=level).filter_map(|n| rest.find(&format!("\n{} ", "#".repeat(n))));
    &rest[..ends.min().unwrap_or(rest.len())]
}

#[test]
fn the_architecture_names_what_there_is() {
    let page = read(&root().join("docs/architecture.md"));
    let map = read(&root().join("docs/code-map.md"));
    for crate_folder in entries(&root().join("crates")) {
        let name = crate_folder.file_name().expect("a folder").to_string_lossy().into_owned();
        let rows =
            section(&map, &format!("## {name}")).lines().filter(|row| row.starts_with("| `"));
        assert!(rows.count() > 0, "{name} has no modules in the code map");
    }
    let integrator = "| `integrator` | The integrators that can serve as models of a plant. |";
    assert!(section(&map, "## pinc-ode").contains(integrator));

    let folders = ["crates/", "tests/", "configs/", "benches/", "docs/", "examples/", "fuzz/"];
    let is_path = |text: &&str| folders.iter().any(|folder| text.starts_with(folder));
    let is_pattern = |text: &str| text.contains("NAME") || text.contains('*');
    for path in quoted(&prose(&page)).filter(is_path).filter(|path| !is_pattern(path)) {
        assert!(root().join(path).exists(), "{path}");
    }

    let mut code = files(&root().join("tests"), "rs");
    code.extend(files(&root().join("crates"), "rs"));
    let code: String = code.iter().map(|path| read(path)).collect();
    let is_test = |text: &&str| {
        text.matches('_').count() >= 2 && text.chars().all(|c| c.is_alphanumeric() || c == '_')
    };
    let invariants = section(&page, "## Invariants");
    let tests: Vec<_> = quoted(invariants).filter(is_test).collect();
    assert!(tests.len() > 20, "{tests:?}");
    for test in tests {
        assert!(code.contains(&format!("fn {test}(")), "{test}");
    }
}

/// Hand-written text is what somebody has to read: tables in files and generated sections do not count.
#[test]
fn the_documents_stay_short() {
    let mut pages = files(&root().join("docs"), "md");
    pages.push(root().join("README.md"));
    let words = |path: &PathBuf| {
        let text = fs::read_to_string(path).expect("a page");
        text.split_whitespace().count()
    };
    let count: usize = pages.iter().map(words).sum();
    assert!(count <= 40_000, "{count} words in README.md and docs/");
}
