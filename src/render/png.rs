//! Converts SVGs of this program to PNG, one to a picture, several to an animated one (APNG, which browsers play). Text uses a font that the program contains, so that a picture is the same on
//! every machine.

use anyhow::Context;
use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree};
use std::sync::Arc;

/// Largest picture [pixels]: 400 MB of memory.
const LARGEST: f64 = 1e8;

/// The picture at `pixels_per_unit` pixels per user unit of the SVG, as the bytes of a PNG file.
pub fn encode(svg: &str, pixels_per_unit: f64) -> anyhow::Result<Vec<u8>> {
    paint(svg, pixels_per_unit, &options()?)?.encode_png().context("the picture cannot be encoded")
}

/// Pictures of one size, one after the other at so many a second, for ever, as the bytes of an animated PNG file.
pub fn encode_animation(svgs: &[&str], pixels_per_unit: f64, per_second: u16) -> anyhow::Result<Vec<u8>> {
    let options = options()?;
    let first = paint(svgs.first().context("no picture")?, pixels_per_unit, &options)?;
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, first.width(), first.height());
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_animated(u32::try_from(svgs.len())?, 0)?;
    encoder.set_frame_delay(1, per_second)?;
    let mut writer = encoder.write_header()?;
    for (i, svg) in svgs.iter().enumerate() {
        let painted = if i == 0 { first.clone() } else { paint(svg, pixels_per_unit, &options)? };
        // The page is white all over: nothing shows through.
        let rgb: Vec<u8> = painted.data().as_chunks::<4>().0.iter().flat_map(|[r, g, b, _]| [*r, *g, *b]).collect();
        writer.write_image_data(&rgb)?;
    }
    writer.finish()?;
    Ok(bytes)
}

/// The one font that text is written with.
fn options() -> anyhow::Result<Options<'static>> {
    let mut options = Options::default();
    let fonts = Arc::make_mut(&mut options.fontdb);
    fonts.load_font_data(epaint_default_fonts::UBUNTU_LIGHT.to_vec());
    let family = fonts.faces().find_map(|f| f.families.first()).map(|(name, _)| name.clone());
    fonts.set_sans_serif_family(family.context("the font that the program carries has no name")?);
    Ok(options)
}

fn paint(svg: &str, pixels_per_unit: f64, options: &Options<'_>) -> anyhow::Result<Pixmap> {
    let tree = Tree::from_str(svg, options).context("the drawing is no SVG")?;
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
    Ok(pixmap)
}
