//! Converts an SVG of this program to PNG. Text uses a font that the program contains, so that a picture is the same on
//! every machine.

use anyhow::Context;
use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree};
use std::sync::Arc;

/// Largest picture [pixels]: 400 MB of memory.
const LARGEST: f64 = 1e8;

/// The picture at `pixels_per_unit` pixels per user unit of the SVG, as the bytes of a PNG file.
pub fn encode(svg: &str, pixels_per_unit: f64) -> anyhow::Result<Vec<u8>> {
    let mut options = Options::default();
    let fonts = Arc::make_mut(&mut options.fontdb);
    fonts.load_font_data(epaint_default_fonts::UBUNTU_LIGHT.to_vec());
    let family = fonts.faces().find_map(|f| f.families.first()).map(|(name, _)| name.clone());
    fonts.set_sans_serif_family(family.context("the font that the program carries has no name")?);
    let tree = Tree::from_str(svg, &options).context("the drawing is no SVG")?;
    let size = [tree.size().width(), tree.size().height()].map(|s| (f64::from(s) * pixels_per_unit).ceil());
    anyhow::ensure!(
        size[0] * size[1] <= LARGEST,
        "the picture would have {:.0} x {:.0} pixels; it may have {LARGEST:.0} in all",
        size[0],
        size[1]
    );
    let mut pixmap = Pixmap::new(size[0] as u32, size[1] as u32).context("the picture has no size")?;
    let scale = pixels_per_unit as f32;
    resvg::render(&tree, Transform::from_scale(scale, scale), &mut pixmap.as_mut());
    pixmap.encode_png().context("the picture cannot be encoded")
}
