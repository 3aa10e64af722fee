//! What verbs have in common that show a quantity of a recording: the quantity's arguments of printing and drawing, and the writing of pictures.

use super::Failure;
use crate::render;
use std::path::{Path, PathBuf};

/// How a result is shown.
#[derive(clap::Args, Debug)]
pub struct SheetArgs {
    /// Picture to write, .svg or .png
    #[arg(short, long = "output", value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Print JSON
    #[arg(long, conflicts_with = "csv")]
    pub json: bool,
    /// Print all points as CSV
    #[arg(long)]
    pub csv: bool,
}

impl SheetArgs {
    /// Refuses a picture that cannot be written, before anything is computed.
    pub fn check<'a>(&'a self, inputs: impl IntoIterator<Item = &'a Path> + Clone) -> Result<(), Failure> {
        let Some(path) = &self.output else { return Ok(()) };
        if !path.extension().is_some_and(|e| e == "svg" || e == "png") {
            return Err(Failure::Input(format!("{}: drawings end in .svg or .png", path.display())));
        }
        super::check_outputs([path.as_path()], inputs)
    }

    /// Writes the picture, if one is wanted.
    pub fn draw(&self, svg: impl FnOnce() -> String) -> Result<(), Failure> {
        let Some(path) = &self.output else { return Ok(()) };
        let is_png = path.extension().is_some_and(|e| e == "png");
        let bytes = if is_png { render::png::encode(&svg(), 2.0)? } else { svg().into_bytes() };
        Ok(crate::output::write(path, &bytes)?)
    }

    /// The line that ends a text: where the picture is.
    pub fn drawn(&self) -> String {
        self.output.as_ref().map_or(String::new(), |path| format!("drawn in {}\n", path.display()))
    }
}

/// A unit as titles and heads of tables show it.
pub fn bracketed(unit: &str) -> String {
    if unit.is_empty() { String::new() } else { format!("[{unit}]") }
}

/// Four digits at least: SI units make some quantities small.
pub fn digits(value: f64) -> String {
    if value.abs() >= 0.01 || value == 0.0 { format!("{value:.5}") } else { format!("{value:.3e}") }
}
