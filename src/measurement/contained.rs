//! Contains panics of libraries that read foreign formats: a panic becomes an ordinary error.
//!
//! Parquet's decoders (60.1) trust a file's metadata about its pages and index out of bounds if it is wrong. This
//! cannot be checked from outside before they decode.

use super::columns::ColumnsError;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::path::Path;

thread_local! {
    /// Whether panics of this thread are currently contained.
    static CONTAINS_PANICS: Cell<bool> = const { Cell::new(false) };
}

/// Suppresses the output of contained panics. To be called once, at program start.
pub fn silence_contained_panics() {
    let usual = take_hook();
    set_hook(Box::new(move |info| {
        if !CONTAINS_PANICS.get() {
            usual(info);
        }
    }));
}

/// Runs a function that may panic while it reads `path`; a panic is returned as an error.
pub(super) fn contained<T>(path: &Path, reads: impl FnOnce() -> Result<T, ColumnsError>) -> Result<T, ColumnsError> {
    CONTAINS_PANICS.set(true);
    // Partial results are discarded with the error, so that no half-changed state is visible.
    let result = catch_unwind(AssertUnwindSafe(reads));
    CONTAINS_PANICS.set(false);
    result.unwrap_or_else(|panic| {
        let said = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
        Err(ColumnsError::Damaged { path: path.to_path_buf(), said: said.map(str::to_string) })
    })
}
