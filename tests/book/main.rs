//! Writes the sources of the book into `target/book-source`, from which mdBook builds it. With pages
//! as arguments, it moves their measured tables into files instead:
//!
//! ```sh
//! cargo run -p pinc-tests -- docs/results.md
//! ```

use pinc_tests::book;
use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let pages: Vec<String> = std::env::args().skip(1).collect();
    let done = if pages.is_empty() {
        let into = book::root().join("target/book-source");
        // Pages that docs/ no longer has; the folder may be missing.
        let _ = std::fs::remove_dir_all(&into);
        book::write_sources(&into)
    } else {
        pages.iter().try_for_each(|page| move_tables(Path::new(page)))
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            use std::io::Write;
            // Failing to print is harmless: the exit code says it too.
            let _ = writeln!(std::io::stderr(), "error: {problem}");
            ExitCode::FAILURE
        }
    }
}

fn move_tables(path: &Path) -> Result<(), String> {
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    book::write(path, &book::moved_to_files(&book::page(path)?, &name))
}
