//! Colours that mean the same in every viewer, on pages and in print.

/// Colours of curves, of bodies in their order and of drives side by side: the palette of Okabe and Ito (2008), which the colour-blind tell apart,
/// without its black, with the colours that are furthest apart first.
pub const CURVE_COLOURS: [[u8; 3]; 7] =
    [[86, 180, 233], [230, 159, 0], [0, 158, 115], [204, 121, 167], [240, 228, 66], [213, 94, 0], [0, 114, 178]];

/// Contact forces.
pub const FORCE: [u8; 3] = [220, 38, 60];
/// Their parts by friction.
pub const FRICTION: [u8; 3] = [60, 160, 230];

/// A colour as web pages and SVG write it.
pub fn hex([r, g, b]: [u8; 3]) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}
