//! Frames of a recording as an SVG drawing to print: one panel per instant, all with the same view and the same scales.
//!
//! Contours are in a group that transforms millimetres of the world, y up, into user units of the page; arcs remain
//! arcs. Arrows, numbers and the legend are drawn in user units (one pixel on a screen), y down. The arrow of a contact
//! starts at the contact point on the body and shows the force on the link, f = n N + t T with t = n turned by +90
//! degrees.

pub mod contours;
mod forces;
mod labels;
mod legend;

pub(crate) use forces::push_arrow;

use super::escape;
use crate::recording::frame::{BodyKind, Frame, Header, Impact, Outline};
use crate::recording::view_geometry::{polyline, scene_bounds};
use contours::{LONGEST_ARC_RAD, Pose, body_pose, circle_data, link_pose, longest_arc_rad, mm, path_data, reach_m};
use labels::{OccupiedPlaces, Rect, take_place, take_place_beside};
use std::fmt::Write;

/// Centre of the view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ViewCentre {
    /// The whole drive.
    Drive,
    /// Index into `Header::bodies`.
    Body(usize),
    /// Index into `Header::links`; the view follows it.
    Link(usize),
}

/// Options of a drawing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SnapshotOptions<'a> {
    pub around: ViewCentre,
    /// Width of the view [mm]; None: fitted.
    pub width_mm: Option<f64>,
    /// Whether forces in joints are drawn.
    pub joints: bool,
    /// Impacts of the recording: contacts that belong to one have its peak beside them.
    pub impacts: &'a [Impact],
}

/// A drawing and its properties.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    pub svg: String,
    /// Size of the page [user units].
    pub width: f64,
    pub height: f64,
    /// User units per millimetre of the world.
    pub units_per_mm: f64,
    /// User units per newton; None if nothing is drawn with it.
    pub contact_units_per_n: Option<f64>,
    pub joint_units_per_n: Option<f64>,
}

/// Maximum number of panels in a row.
const MAX_IN_A_ROW: usize = 4;
/// Width of a panel with 1, 2, 3 and 4 in a row [user units].
const PANEL_WIDTH: [f64; MAX_IN_A_ROW] = [960.0, 600.0, 460.0, 400.0];
const MARGIN: f64 = 16.0;
const TITLE_HEIGHT: f64 = 34.0;
/// View around a link [pitches], and its height as a fraction of its width.
const LINK_VIEW_PITCHES: f64 = 6.0;
const LINK_VIEW_ASPECT: f64 = 0.72;
/// Pitch on the page above which every link and every gap has its number, and every contact its force [user units].
const NUMBERED_PITCH: f64 = 38.0;
/// Colour of rollers, which lie in front of the links.
const ROLLER_COLOUR: &str = "#7a6a1e";
/// Colours of the links' rows, in the order of `Header::link_outlines`; clearly different also in grey.
const ROW_COLOURS: [&str; 6] = ["#1f5fbf", "#c8641a", "#2f8a57", "#8d4bb4", "#a08a00", "#5a6b7b"];
const INK: &str = "#223";
/// `recording::palette::FORCE`.
const FORCE: &str = "#dc263c";
const JOINT_FORCE: &str = "#0a7a5c";

/// Position of a panel on the page and its view.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Panel {
    left: f64,
    top: f64,
    width: f64,
    height: f64,
    /// The point at its centre [m].
    centre_m: [f64; 2],
    units_per_m: f64,
}

impl Panel {
    /// Transforms a point of the world to the page.
    fn on_page(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [
            self.left + 0.5 * self.width + (x - self.centre_m[0]) * self.units_per_m,
            self.top + 0.5 * self.height - (y - self.centre_m[1]) * self.units_per_m,
        ]
    }

    /// Whether a disc may be partly visible.
    fn sees(&self, [x, y]: [f64; 2], radius_m: f64) -> bool {
        let half = [0.5 * self.width / self.units_per_m, 0.5 * self.height / self.units_per_m];
        (x - self.centre_m[0]).abs() <= half[0] + radius_m && (y - self.centre_m[1]).abs() <= half[1] + radius_m
    }
}

/// Data shared by all parts of a drawing.
struct DrawingSheet<'a> {
    header: &'a Header,
    options: SnapshotOptions<'a>,
    units_per_m: f64,
    /// Font size of numbers in the panels [user units].
    font: f64,
    /// Line width of contours [user units].
    stroke: f64,
    contact_units_per_n: Option<f64>,
    joint_units_per_n: Option<f64>,
}

impl DrawingSheet<'_> {
    /// Pitch of the chain on the page [user units].
    fn pitch(&self) -> f64 {
        pitch_m(self.header) * self.units_per_m
    }
}

fn pitch_m(header: &Header) -> f64 {
    header.links.first().map_or(8e-3, |l| l.pitch_m)
}

/// Draws frames of a recording, one panel each.
///
/// # Panics
/// Without frames, if the link or body of `options.around` does not exist, and if columns are shorter than the header
/// states.
pub fn draw(header: &Header, frames: &[&Frame], options: SnapshotOptions<'_>) -> Drawing {
    assert!(!frames.is_empty(), "no frame to draw");
    let rows = frames.len().div_ceil(MAX_IN_A_ROW);
    let columns = frames.len().div_ceil(rows);
    let caption = if frames.len() == 1 { 0.0 } else { 36.0 };
    let (sheet, panels) = lay_out(header, frames, options, columns, |i, [panel_width, panel_height]| {
        let left = MARGIN + (i % columns) as f64 * (panel_width + MARGIN);
        [left, TITLE_HEIGHT + caption + (i / columns) as f64 * (panel_height + caption + 8.0)]
    });
    let width = MARGIN + columns as f64 * (PANEL_WIDTH[columns - 1] + MARGIN);
    sheet.drawing(frames, &panels, width)
}

/// Draws frames of a recording, each on a page of its own; all pages have the same size, view and scales.
///
/// # Panics
/// As [`draw`].
pub fn draw_pages(header: &Header, frames: &[&Frame], options: SnapshotOptions<'_>) -> Vec<Drawing> {
    assert!(!frames.is_empty(), "no frame to draw");
    let (sheet, panels) = lay_out(header, frames, options, 1, |_, _| [MARGIN, TITLE_HEIGHT]);
    let width = 2.0 * MARGIN + PANEL_WIDTH[0];
    let pages = frames.iter().zip(&panels);
    pages.map(|(frame, panel)| sheet.drawing(std::slice::from_ref(frame), std::slice::from_ref(panel), width)).collect()
}

/// What all panels share, and where each stands: `place` makes left and top out of its number and size.
fn lay_out<'a>(
    header: &'a Header,
    frames: &[&Frame],
    options: SnapshotOptions<'a>,
    columns: usize,
    place: impl Fn(usize, [f64; 2]) -> [f64; 2],
) -> (DrawingSheet<'a>, Vec<Panel>) {
    let [width_m, height_m] = view_size_m(header, frames, options);
    let panel_width = PANEL_WIDTH[columns - 1];
    let units_per_m = panel_width / width_m;
    let size = [panel_width, height_m * units_per_m];
    let panel = |(i, frame): (usize, &&Frame)| {
        let [left, top] = place(i, size);
        let centre_m = centre_m(header, frames, frame, options, width_m);
        Panel { left, top, width: size[0], height: size[1], centre_m, units_per_m }
    };
    let panels: Vec<Panel> = frames.iter().enumerate().map(panel).collect();
    let mut sheet = DrawingSheet {
        header,
        options,
        units_per_m,
        font: if columns == 1 { 14.5 } else { 11.5 },
        stroke: (pitch_m(header) * units_per_m / 60.0).clamp(0.6, 1.6),
        contact_units_per_n: None,
        joint_units_per_n: None,
    };
    sheet.contact_units_per_n = forces::contact_scale(&sheet, frames, &panels);
    sheet.joint_units_per_n = if options.joints { forces::joint_scale(&sheet, frames, &panels) } else { None };
    (sheet, panels)
}

impl DrawingSheet<'_> {
    /// A page with a panel for every frame, its title and its legend.
    fn drawing(&self, frames: &[&Frame], panels: &[Panel], width: f64) -> Drawing {
        let bottom = panels.iter().map(|p| p.top + p.height).fold(0.0, f64::max);
        let entries = legend::entries(self, width);
        let height = bottom + legend::height(&entries);
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.2} {height:.2}\" width=\"{width:.2}\" \
             height=\"{height:.2}\" font-family=\"sans-serif\">\n\
             <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
        );
        push_title(&mut svg, self, frames, width);
        for (i, (frame, panel)) in frames.iter().zip(panels).enumerate() {
            push_panel(&mut svg, self, frame, panel, i);
            if frames.len() > 1 {
                push_caption(&mut svg, frame, panel);
            }
        }
        legend::push(&mut svg, &entries, bottom);
        svg.push_str("</svg>\n");
        Drawing {
            svg,
            width,
            height,
            units_per_mm: self.units_per_m * 1e-3,
            contact_units_per_n: self.contact_units_per_n,
            joint_units_per_n: self.joint_units_per_n,
        }
    }
}

/// Bounding box of a body at its current pose: (lower, upper) corner [m].
fn body_box_m(header: &Header, frame: &Frame, k: usize) -> [[f64; 2]; 2] {
    let pose = body_pose(header, frame, k);
    let mut corners = [[pose.x_m, pose.y_m]; 2];
    if header.bodies[k].rotor {
        // The same at every angle, so that the view is the same in all panels.
        let reach = header.bodies[k].outline.as_ref().map_or(0.0, tip_radius_m);
        return [[pose.x_m - reach, pose.y_m - reach], [pose.x_m + reach, pose.y_m + reach]];
    }
    let points = header.bodies[k].outline.as_ref().map(polyline).unwrap_or_default();
    for (i, p) in points.into_iter().map(|p| pose.apply(p)).enumerate() {
        for a in 0..2 {
            corners[0][a] = if i == 0 { p[a] } else { corners[0][a].min(p[a]) };
            corners[1][a] = if i == 0 { p[a] } else { corners[1][a].max(p[a]) };
        }
    }
    corners
}

fn tip_radius_m(outline: &Outline) -> f64 {
    polyline(outline).into_iter().map(|[x, y]| libm::hypot(x, y)).fold(0.0, f64::max)
}

/// Bounding box of the whole drive, chain included: (lower, upper) corner [m].
fn drive_box_m(header: &Header, frames: &[&Frame]) -> [[f64; 2]; 2] {
    let (mut low, mut high) = scene_bounds(header);
    for frame in frames {
        for (x, y) in frame.links.x_m.iter().zip(&frame.links.y_m) {
            low = [low[0].min(*x), low[1].min(*y)];
            high = [high[0].max(*x), high[1].max(*y)];
        }
    }
    [low, high]
}

/// Width and height of the view [m].
fn view_size_m(header: &Header, frames: &[&Frame], options: SnapshotOptions<'_>) -> [f64; 2] {
    let room_m = 2.2 * pitch_m(header);
    let of_box = |[low, high]: [[f64; 2]; 2]| [high[0] - low[0] + room_m, high[1] - low[1] + room_m];
    let [width, height] = match options.around {
        ViewCentre::Drive => of_box(drive_box_m(header, frames)),
        ViewCentre::Body(k) => of_box(body_box_m(header, frames[0], k)),
        ViewCentre::Link(i) => {
            let width = LINK_VIEW_PITCHES * header.links[i].pitch_m;
            [width, LINK_VIEW_ASPECT * width]
        }
    };
    // Limits the aspect ratio.
    let (width, height) = (width.max(height / 1.3), height.max(width * 0.3));
    match options.width_mm {
        None => [width, height],
        // A view of a part of a body has the aspect ratio of a link view.
        Some(wanted) if wanted * 1e-3 < width - room_m && matches!(options.around, ViewCentre::Body(_)) => {
            [wanted * 1e-3, wanted * 1e-3 * LINK_VIEW_ASPECT]
        }
        Some(wanted) => [wanted * 1e-3, wanted * 1e-3 * height / width],
    }
}

/// The centre of a frame's view [m].
fn centre_m(header: &Header, frames: &[&Frame], frame: &Frame, options: SnapshotOptions<'_>, width_m: f64) -> [f64; 2] {
    let middle = |[low, high]: [[f64; 2]; 2]| [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])];
    match options.around {
        ViewCentre::Drive => middle(drive_box_m(header, frames)),
        ViewCentre::Link(i) => [frame.links.x_m[i], frame.links.y_m[i]],
        ViewCentre::Body(k) => {
            let corners = body_box_m(header, frames[0], k);
            // A view of a part of the body is centred where the load is largest, the same place in all panels.
            let part = width_m < corners[1][0] - corners[0][0];
            let loaded = if part { forces::most_loaded_point_m(frames[0], k) } else { None };
            loaded.unwrap_or(middle(corners))
        }
    }
}

fn push_title(svg: &mut String, sheet: &DrawingSheet, frames: &[&Frame], width: f64) {
    let around = match sheet.options.around {
        ViewCentre::Drive => String::new(),
        ViewCentre::Body(k) => format!(", around {}", sheet.header.bodies[k].path),
        ViewCentre::Link(i) => format!(", around link {i}"),
    };
    let title = format!("{}{around}", sheet.header.drive_name);
    push_text(svg, [MARGIN, 0.5 * TITLE_HEIGHT], 15.0, "start", INK, &title);
    if let [frame] = frames {
        push_text(svg, [width - MARGIN, 0.5 * TITLE_HEIGHT], 14.0, "end", INK, &instant(frame).join(", "));
    }
}

fn push_caption(svg: &mut String, frame: &Frame, panel: &Panel) {
    let [time, rest] = instant(frame);
    push_text(svg, [panel.left, panel.top - 25.0], 13.0, "start", INK, &time);
    push_text(svg, [panel.left, panel.top - 10.0], 11.0, "start", "#556", &rest);
}

/// The instant in words: time; step and crank angle.
fn instant(frame: &Frame) -> [String; 2] {
    [
        format!("t = {:.4} ms", frame.t_s * 1e3),
        format!("step {}, crank {:.2}\u{b0}", frame.step, frame.crank_angle_rad.to_degrees()),
    ]
}

fn push_panel(svg: &mut String, sheet: &DrawingSheet, frame: &Frame, panel: &Panel, index: usize) {
    let Panel { left, top, width, height, .. } = *panel;
    let area = format!("x=\"{left:.2}\" y=\"{top:.2}\" width=\"{width:.2}\" height=\"{height:.2}\"");
    let _infallible = writeln!(
        svg,
        "<clipPath id=\"panel{index}\"><rect {area}/></clipPath>\n\
         <g class=\"panel\" clip-path=\"url(#panel{index})\">"
    );
    push_contours(svg, sheet, frame, panel);
    let middle = [left + 0.5 * width, top + 0.5 * height];
    let mut taken = OccupiedPlaces {
        panel: Rect { centre: middle, half: [0.5 * width - 2.0, 0.5 * height - 2.0] },
        boxes: Vec::new(),
        strokes: Vec::new(),
    };
    if sheet.options.joints {
        forces::push_joints(svg, sheet, frame, panel, &mut taken);
    }
    forces::push_contacts(svg, sheet, frame, panel, &mut taken);
    push_link_numbers(svg, sheet, frame, panel, &mut taken);
    push_body_names(svg, sheet, frame, panel, &mut taken);
    push_gap_numbers(svg, sheet, frame, panel, &mut taken);
    forces::push_contact_numbers(svg, sheet, frame, panel, &mut taken);
    let _infallible = writeln!(svg, "</g>\n<rect {area} fill=\"none\" stroke=\"#aab\" stroke-width=\"0.8\"/>");
}

/// Bodies, then links over them, in millimetres of the world.
fn push_contours(svg: &mut String, sheet: &DrawingSheet, frame: &Frame, panel: &Panel) {
    let scale = sheet.units_per_m * 1e-3;
    let [x0, y0] = panel.on_page([0.0, 0.0]);
    let _infallible = writeln!(
        svg,
        "<g class=\"contours\" transform=\"matrix({scale} 0 0 {} {x0} {y0})\" stroke-width=\"{:.5}\" \
         stroke-linejoin=\"round\">",
        -scale,
        sheet.stroke / scale
    );
    for (k, body) in sheet.header.bodies.iter().enumerate() {
        let Some(outline) = &body.outline else { continue };
        let pose = body_pose(sheet.header, frame, k);
        if panel.sees([pose.x_m, pose.y_m], reach_m(outline)) {
            let fill = if body.rotor { "#e4e6ea" } else { "#dfe8d8" };
            push_outline(svg, outline, pose, sheet.units_per_m, (fill, 1.0, INK));
        }
    }
    // Rows are drawn from back to front; the first, which has the bushes, is in front.
    for row in (0..sheet.header.link_outlines.len()).rev() {
        let outline = &sheet.header.link_outlines[row];
        let (reach, colour) = (reach_m(outline), ROW_COLOURS[row % ROW_COLOURS.len()]);
        for (i, _) in sheet.header.links.iter().enumerate().filter(|(_, l)| l.outline as usize == row) {
            let pose = link_pose(frame, i);
            if panel.sees([pose.x_m, pose.y_m], reach) {
                push_outline(svg, outline, pose, sheet.units_per_m, (colour, 0.14, colour));
            }
        }
    }
    for (i, roller) in sheet.header.rollers.iter().enumerate() {
        let place = frame.rollers.x_m.get(i).zip(frame.rollers.y_m.get(i)).map(|(x, y)| [*x, *y]);
        if let Some([x, y]) = place.filter(|place| panel.sees(*place, roller.radius_m)) {
            for radius_m in [roller.radius_m, roller.bore_radius_m] {
                let [x, y, r] = [x, y, radius_m].map(mm);
                let style = format!("fill=\"none\" stroke=\"{ROLLER_COLOUR}\"");
                let _infallible = writeln!(svg, "<circle class=\"roller\" cx=\"{x}\" cy=\"{y}\" r=\"{r}\" {style}/>");
            }
        }
    }
    svg.push_str("</g>\n");
}

fn push_outline(
    svg: &mut String,
    outline: &Outline,
    pose: Pose,
    units_per_m: f64,
    (fill, opacity, line): (&str, f64, &str),
) {
    let data = path_data(outline, pose, units_per_m);
    let _infallible = if data.is_empty() {
        Ok(())
    } else if outline.closed {
        writeln!(svg, "<path d=\"{data}\" fill=\"{fill}\" fill-opacity=\"{opacity}\" stroke=\"{line}\"/>")
    } else {
        writeln!(svg, "<path d=\"{data}\" fill=\"none\" stroke=\"{line}\"/>")
    };
    for c in &outline.circles {
        let style = format!("fill=\"none\" stroke=\"{line}\" stroke-opacity=\"0.8\"");
        let [x, y] = pose.apply([c.x_m, c.y_m]).map(mm);
        let _infallible = if longest_arc_rad(c.radius_m, units_per_m) < LONGEST_ARC_RAD {
            writeln!(svg, "<path class=\"circle\" d=\"{}\" {style}/>", circle_data(c, pose, units_per_m))
        } else {
            writeln!(svg, "<circle cx=\"{x}\" cy=\"{y}\" r=\"{}\" {style}/>", mm(c.radius_m))
        };
    }
}

/// Interval between numbered links or gaps: one in a close-up, larger and round in a wide view.
fn number_stride(pitch: f64) -> usize {
    /// Minimum distance of numbers if not all are drawn [user units].
    const MIN_NUMBER_DISTANCE: f64 = 80.0;
    if pitch >= NUMBERED_PITCH {
        return 1;
    }
    [5, 10, 20, 50].into_iter().find(|s| *s as f64 * pitch >= MIN_NUMBER_DISTANCE).unwrap_or(100)
}

fn push_link_numbers(svg: &mut String, sheet: &DrawingSheet, frame: &Frame, panel: &Panel, taken: &mut OccupiedPlaces) {
    let stride = number_stride(sheet.pitch());
    for (i, link) in sheet.header.links.iter().enumerate().step_by(stride) {
        let pose = link_pose(frame, i);
        // On the link if there is room, slightly away from the teeth; otherwise outside of the loop.
        let aside_m = if stride == 1 { -0.27 * link.pitch_m } else { -link.pitch_m };
        let text = [i.to_string()];
        let place = Rect::around_text(&text, sheet.font, panel.on_page(pose.apply([0.0, aside_m])));
        if take_place(taken, place) {
            let colour = ROW_COLOURS[link.outline as usize % ROW_COLOURS.len()];
            push_number(svg, &place, sheet.font, colour, &text);
        }
    }
}

/// Numbers of tooth gaps, below their roots.
fn push_gap_numbers(svg: &mut String, sheet: &DrawingSheet, frame: &Frame, panel: &Panel, taken: &mut OccupiedPlaces) {
    let stride = number_stride(sheet.pitch()) as u32;
    let size = 0.85 * sheet.font;
    for (k, body) in sheet.header.bodies.iter().enumerate().filter(|(_, b)| b.rotor && b.teeth > 0) {
        let Some(outline) = &body.outline else { continue };
        let root_m = polyline(outline).into_iter().map(|[x, y]| libm::hypot(x, y)).fold(f64::INFINITY, f64::min);
        let radius_m = root_m - 1.3 * size / sheet.units_per_m;
        let pose = body_pose(sheet.header, frame, k);
        for gap in (0..body.teeth).step_by(stride as usize) {
            let (s, c) = crate::units::sin_cos(std::f64::consts::TAU * f64::from(gap) / f64::from(body.teeth));
            let text = [gap.to_string()];
            let place = Rect::around_text(&text, size, panel.on_page(pose.apply([radius_m * c, radius_m * s])));
            if take_place(taken, place) {
                push_number(svg, &place, size, "#667", &text);
            }
        }
    }
}

/// Names of the bodies: sprockets on their axes, guides beside their middle.
fn push_body_names(svg: &mut String, sheet: &DrawingSheet, frame: &Frame, panel: &Panel, taken: &mut OccupiedPlaces) {
    for (k, body) in sheet.header.bodies.iter().enumerate() {
        let name = crate::diag::last_name(&body.path).to_string();
        let [low, high] = body_box_m(sheet.header, frame, k);
        let at = panel.on_page([0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])]);
        if body.rotor {
            let turning = body.coordinate.and_then(|q| frame.rotors.speed_rad_s.get(q as usize));
            let speed = turning.copied().unwrap_or(0.0) / crate::units::RPM;
            let lines = [name, format!("{} teeth", body.teeth), format!("{speed:.0} rpm")];
            let place = Rect::around_text(&lines, sheet.font, at);
            if take_place(taken, place) {
                push_number(svg, &place, sheet.font, INK, &lines);
            }
        } else {
            // A housing is named by its plunger, a cam by its valve.
            if [BodyKind::Housing, BodyKind::Cam].iter().any(|kind| body.kind == *kind as u32) {
                continue;
            }
            // One of several valves has their name and a number.
            let name = body.path.split_once("valves.").map_or(name, |(_, valve)| valve.replace('.', " "));
            let lines = [format!("{} {name}", BodyKind::name(body.kind))];
            let like = Rect::around_text(&lines, sheet.font, at);
            let inside = Rect { centre: at, half: [0.0; 2] }.is_inside(&taken.panel);
            // Towards the inside of most loops, away from the chain: below the upper guide, above the lower one.
            if inside && let Some(place) = take_place_beside(taken, like, [at, at]) {
                push_number(svg, &place, sheet.font, INK, &lines);
            }
        }
    }
}

/// The largest of 1, 2, 5 times a power of ten that is not above `v`.
pub(crate) fn round_below(v: f64) -> f64 {
    // Powers from repeated factors of ten are exact, so that they print as written.
    let (mut up, mut down) = (1.0, 1.0);
    while up * 10.0 <= v && up < 1e12 {
        up *= 10.0;
    }
    while up / down > v && down < 1e12 {
        down *= 10.0;
    }
    [5.0, 2.0, 1.0].into_iter().map(|f| f * up / down).find(|r| *r <= v).unwrap_or(up / down)
}

/// Lines of text in their box, with a white outline.
fn push_number(svg: &mut String, place: &Rect, size: f64, colour: &str, lines: &[String]) {
    let line = 2.0 * place.half[1] / lines.len() as f64;
    for (i, text) in lines.iter().enumerate() {
        let y = place.centre[1] - place.half[1] + (i as f64 + 0.5) * line;
        push_text(svg, [place.centre[0], y], size, "middle", colour, text);
    }
}

/// A line of text that is vertically centred at `y`.
fn push_text(svg: &mut String, [x, y]: [f64; 2], size: f64, anchor: &str, colour: &str, text: &str) {
    let _infallible = writeln!(
        svg,
        "<text x=\"{x:.2}\" y=\"{:.2}\" font-size=\"{size:.1}\" text-anchor=\"{anchor}\" fill=\"{colour}\" \
         stroke=\"#fff\" stroke-width=\"2.5\" stroke-linejoin=\"round\" paint-order=\"stroke\">{}</text>",
        y + 0.35 * size,
        escape(text)
    );
}

#[cfg(test)]
mod tests {
    #[test]
    fn forces_have_the_colour_of_all_viewers() {
        use crate::recording::palette;
        assert_eq!(super::FORCE, palette::hex(palette::FORCE));
    }
}
