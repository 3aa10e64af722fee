//! Drawings of silent chain links and their sprockets.

use super::path_data;
use crate::geometry::Vec2;
use crate::geometry::chain::silent::SilentLinkContour;
use crate::geometry::profile::Profile;
use crate::geometry::silent_sprocket::SilentSprocket;

/// A link with its pin line; the teeth point up, towards the sprocket.
pub fn link_svg(link: &SilentLinkContour, profile: &Profile) -> String {
    let (low, high) = profile.bounds();
    let margin = 0.5;
    let (left, top) = (low.x * 1e3 - margin, -high.y * 1e3 - margin);
    let (width, height) = ((high.x - low.x) * 1e3 + 2.0 * margin, (high.y - low.y) * 1e3 + 4.0 * margin);
    let joint = 0.5e3 * link.pin_pitch_m;
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"{left} {top} {width} {height}\" width=\"800\">\n\
         <g transform=\"scale(1 -1)\" fill=\"none\" stroke-width=\"{stroke}\">\n\
         <path d=\"{d}\" fill=\"#d8dce2\" stroke=\"#223\"/>\n\
         <path d=\"M{left} 0H{right}\" stroke=\"#a33\" stroke-dasharray=\"0.3 0.3\"/>\n\
         <circle cx=\"{back}\" r=\"{pin}\" stroke=\"#27c\"/>\n\
         <circle cx=\"{joint}\" r=\"{pin}\" stroke=\"#27c\"/>\n</g>\n\
         <text x=\"{left}\" y=\"{ty}\" font-size=\"{fs}\" font-family=\"sans-serif\">silent link, pin pitch {p} mm, flank pitch {q} mm</text>\n</svg>\n",
        stroke = width / 400.0,
        d = path_data(profile),
        right = left + width,
        back = -joint,
        pin = 0.05 * joint,
        ty = top + height - 0.3 * margin,
        fs = width / 30.0,
        p = link.pin_pitch_m * 1e3,
        q = link.flank_pitch_m * 1e3,
    )
}

/// A sprocket with its pitch circle and one seated link.
pub fn sprocket_svg(sprocket: &SilentSprocket, profile: &Profile) -> String {
    let spec = &sprocket.spec;
    let edge = (sprocket.pitch_radius_m + spec.link.face_distance_m) * 1e3 * 1.08;
    let link = SilentLinkContour::new(spec.link, spec.pitch_m, spec.pitch_m).and_then(|contour| contour.profile());
    let (angle_rad, origin) = sprocket.pose_at_seat(spec.pitch_m, 0.0);
    let joint = Vec2::new(sprocket.pitch_radius_m * 1e3, 0.0);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"{m} {m} {w} {w}\" width=\"800\" height=\"800\">\n\
         <g transform=\"scale(1 -1)\" fill=\"none\" stroke-width=\"{s}\">\n\
         <path d=\"{d}\" fill=\"#d8dce2\" stroke=\"#223\"/>\n\
         <circle r=\"{pitch}\" stroke=\"#a33\" stroke-dasharray=\"1 1\"/>\n\
         <path d=\"{seated}\" stroke=\"#27c\"/>\n\
         <circle cx=\"{jx}\" r=\"{pin}\" stroke=\"#27c\"/>\n\
         <circle r=\"{bore}\" fill=\"#fff\" stroke=\"#223\"/>\n</g>\n\
         <text x=\"{tx}\" y=\"{ty}\" font-size=\"{fs}\" font-family=\"sans-serif\">z = {z}, p = {p} mm, for silent chain</text>\n</svg>\n",
        m = -edge,
        w = 2.0 * edge,
        s = edge / 400.0,
        d = path_data(profile),
        pitch = sprocket.pitch_radius_m * 1e3,
        seated = link.map(|l| path_data(&l.moved(angle_rad, origin))).unwrap_or_default(),
        jx = joint.x,
        pin = spec.pitch_m * 25.0,
        bore = sprocket.root_radius_m * 1e3 * 0.4,
        tx = -edge * 0.98,
        ty = edge * 0.98,
        fs = edge / 22.0,
        z = spec.teeth,
        p = spec.pitch_m * 1e3,
    )
}
