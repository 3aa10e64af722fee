//! Writes messages to the file, on the crate's forwarding thread. The crate's own `FileSink` would do the same, but it
//! drops write errors, and its flush never returns after one (0.36, seen on a full disk).

use anyhow::Result;
use rerun::external::re_log_encoding::{Encoder, EncodingOptions, rrd::CrateVersion};
use rerun::log::LogMsg;
use rerun::sink::{LogSink, SinkFlushError};
use std::fs::File;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// The footer, a table of contents, takes about 10 kB of memory per message until it is written. Longer recordings have
/// none; a viewer then reads them from the front, like those of a killed run.
const MESSAGES_WITH_FOOTER: usize = 10_000;

/// Shared between the stream that sends and the sink that checks for errors.
#[derive(Clone)]
pub struct Writer(Arc<Mutex<WriterOutput>>);

struct WriterOutput {
    encoder: Encoder<File>,
    messages: usize,
    /// Reason why writing stopped. Nothing is written afterwards: the file ends with the last whole message and a
    /// partial one.
    failed: Option<String>,
}

impl Writer {
    pub fn new(file: File) -> Result<Writer> {
        let encoder = Encoder::new_eager(CrateVersion::LOCAL, EncodingOptions::PROTOBUF_COMPRESSED, file)?;
        Ok(Writer(Arc::new(Mutex::new(WriterOutput { encoder, messages: 0, failed: None }))))
    }

    /// Whether everything sent so far was written to the file.
    pub fn check(&self) -> Result<()> {
        self.output().failed.as_ref().map_or(Ok(()), |reason| Err(anyhow::anyhow!("{reason}")))
    }

    /// Writes the footer.
    pub fn finish(&self) -> Result<()> {
        self.check()?;
        Ok(self.output().encoder.finish()?)
    }

    fn output(&self) -> MutexGuard<'_, WriterOutput> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl LogSink for Writer {
    fn send(&self, message: LogMsg) {
        let mut output = self.output();
        if output.failed.is_some() {
            return;
        }
        if let Err(error) = output.encoder.append(&message) {
            output.failed = Some(error.to_string());
        }
        output.messages += 1;
        if output.failed.is_some() || output.messages == MESSAGES_WITH_FOOTER {
            output.encoder.do_not_emit_footer();
        }
    }

    fn flush_blocking(&self, _timeout: Duration) -> Result<(), SinkFlushError> {
        self.check().map_err(|error| SinkFlushError::failed(error.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rerun::{RecordingStream, RecordingStreamBuilder, TextDocument};

    #[test]
    fn an_error_while_writing_ends_the_flush_and_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.rrd");
        let writer = Writer::new(File::create(&path).unwrap()).unwrap();
        let (_, store, properties, batching, hooks, _) = RecordingStreamBuilder::new("test").into_args();
        let stream = RecordingStream::new(store, properties, batching, hooks, Box::new(writer.clone())).unwrap();
        writer.output().failed = Some("disk gone".to_owned());
        stream.log_static("a", &TextDocument::new("b")).unwrap();
        assert!(stream.flush_blocking().is_err());
        assert_eq!(writer.check().unwrap_err().to_string(), "disk gone");
        assert_eq!(writer.finish().unwrap_err().to_string(), "disk gone");
    }
}
