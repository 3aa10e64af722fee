//! placeholder
use super::frame::*;
use super::{Sink, ViewOptions};
use std::path::Path;
pub struct McapSink;
impl McapSink { pub fn create(_: &Path, _: &Header, _: ViewOptions) -> anyhow::Result<McapSink> { Ok(McapSink) } }
impl Sink for McapSink {
    fn frame(&mut self, _: &Frame) -> anyhow::Result<()> { Ok(()) }
    fn keyframe(&mut self, _: &Keyframe) -> anyhow::Result<()> { Ok(()) }
    fn event(&mut self, _: &Event) -> anyhow::Result<()> { Ok(()) }
    fn finish(&mut self) -> anyhow::Result<u64> { Ok(0) }
    fn path(&self) -> &Path { Path::new("") }
}
