//! Libraries that read foreign formats, held where a file makes them panic: what they find is an error like any other.
//!
//! Parquet's decoders (60.1) count on what a file's own metadata says of its pages and index beyond them where it lies. No check from
//! outside can tell before they have decoded.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::path::Path;

thread_local! {
    /// Whether a panic of this thread is waited for.
    static HELD: Cell<bool> = const { Cell::new(false) };
}

/// Lets panics that are waited for pass without a word. For the program as a whole, once, at its start.
pub fn hold_quietly() {
    let usual = take_hook();
    set_hook(Box::new(move |info| {
        if !HELD.get() {
            usual(info);
        }
    }));
}

/// Runs what may panic while it reads `path`; a panic is an error that says so.
pub(super) fn contained<T>(path: &Path, reads: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
    HELD.set(true);
    // What was read so far is thrown away with the error: nobody sees it half changed.
    let result = catch_unwind(AssertUnwindSafe(reads));
    HELD.set(false);
    result.unwrap_or_else(|panic| {
        let said = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
        Err(format!("`{}` is damaged: its reader gave up ({})", path.display(), said.unwrap_or("without a word")))
    })
}
