//! Measured series together with those of a model, on one timeline.

use super::writer::Writer;
use crate::output::OutputFile;
use anyhow::Result;
use rerun::{RecordingStream, RecordingStreamBuilder, Scalars, TimeColumn};
use std::path::Path;

/// A series: its path, and its values over time [s].
pub struct Series<'a> {
    pub path: String,
    pub t_s: &'a [f64],
    pub values: &'a [f64],
}

/// Writes all series into one file; every path becomes a plot of its parent.
pub fn write(path: &Path, name: &str, all: &[Series]) -> Result<()> {
    let (mut output, file) = OutputFile::create(path)?;
    let writer = Writer::new(file.try_clone()?)?;
    let id = format!("{:016x}", twox_hash::XxHash3_64::oneshot(name.as_bytes()));
    let (_, store, properties, batching, hooks, _) =
        RecordingStreamBuilder::new("pitchline").recording_id(id.as_str()).into_args();
    let stream = RecordingStream::new(store, properties, batching, hooks, Box::new(writer.clone()))?;
    stream.disable_timeline("log_time");
    stream.disable_timeline("log_tick");
    stream.send_recording_name(name)?;
    for s in all {
        let known: Vec<usize> = (0..s.values.len()).filter(|i| s.values[*i].is_finite()).collect();
        let times = TimeColumn::new_duration_secs("time", known.iter().map(|i| s.t_s[*i]));
        let scalars = Scalars::new(known.iter().map(|i| s.values[*i])).columns_of_unit_batches()?;
        stream.send_columns(s.path.as_str(), [times], scalars)?;
    }
    stream.flush_blocking()?;
    writer.finish()?;
    output.sync(&file)?;
    output.publish()
}
