//! Static data of an `.rrd`: shapes of links, sprockets and guides, colours, names of curves, and a page that explains
//! them. Drawn in millimetres, because the viewer's camera and near plane suit numbers of that size; x to the right, y
//! up, seen from +z. Objects lie in thin layers along z, so that an oblique camera still shows them in place.

use super::blueprint::ViewRect;
use super::rows::{CONTACTS_PAGE, is_energy_or_work, is_lost};
use crate::recording::columns::ColumnKind;
use crate::recording::contact_labels::{drive_of, drives_of, reference_force_n, short_name};
use crate::recording::frame::{BodyInfo, Energy, Header, Outline};
use crate::recording::palette::{CURVE_COLOURS, FORCE, FRICTION};
use crate::recording::view_geometry::{circle, polyline};
use anyhow::Result;
use rerun::external::re_sdk_types::components::{MediaType, PointShading};
use rerun::{
    AnnotationContext, Arrows3D, Color, EntityPath, LineStrips3D, Mesh3D, Points3D, RecordingStream, Rgba32,
    SeriesLines, SeriesPoints, TextDocument, Transform3D, ViewCoordinates,
};

pub const MM_PER_M: f64 = 1e3;

/// Layers along z for each kind of object [pitches]. Points and lines face the camera and need room to tilt.
const Z_BODY: f64 = -0.012;
const Z_INNER: f64 = 0.0;
const Z_OUTER: f64 = 0.008;
const Z_OUTLINE: f64 = 0.018;
const Z_POINTS: f64 = 0.04;
/// Within a link's mesh: heights of the face and the discs [pitches].
const Z_FACE: f64 = 0.002;
const Z_DISC: f64 = 0.004;

/// Where the peaks of impacts are, below the curves which they belong to; and the size of their marks [points].
const IMPACT_PEAKS: &str = "plots/largest_contact_force/impact_peaks";
const PEAK_MARK: f32 = 2.5;

/// Steps of the colour scale of forces.
const FORCE_CLASSES: u16 = 32;

/// Scale of forces as lengths and colours.
#[derive(Clone, Copy, Debug)]
pub struct ForceScale {
    /// Length of arrows [mm/N].
    pub mm_per_n: f32,
    /// Force in the middle of the colour scale [N].
    middle_n: f64,
    /// Height at which pins and contacts are drawn [mm].
    pub z_mm: f32,
}

impl ForceScale {
    /// The mean static tension is drawn 1.5 pitches long and in the middle colour.
    pub fn new(header: &Header) -> ForceScale {
        let middle_n = reference_force_n(header);
        let pitch = pitch_mm(header);
        ForceScale { mm_per_n: (1.5 * pitch / middle_n) as f32, middle_n, z_mm: (Z_POINTS * pitch) as f32 }
    }

    /// Colour class of a force: equal steps of f / (f + middle), which never saturates.
    pub fn class(&self, force_n: f64) -> u16 {
        let share = force_n / (force_n + self.middle_n);
        (share * f64::from(FORCE_CLASSES)).clamp(0.0, f64::from(FORCE_CLASSES - 1)) as u16
    }

    /// Largest force of a class [N].
    fn class_limit_n(&self, class: u16) -> f64 {
        let share = f64::from(class + 1) / f64::from(FORCE_CLASSES);
        if share < 1.0 { self.middle_n * share / (1.0 - share) } else { f64::INFINITY }
    }
}

/// Mean pitch of the chain [mm].
pub fn pitch_mm(header: &Header) -> f64 {
    let sum_m: f64 = header.links.iter().map(|link| link.pitch_m).sum();
    if header.links.is_empty() { 8.0 } else { MM_PER_M * sum_m / header.links.len() as f64 }
}

/// Entity of a body: `sprockets.driver` is `bodies/sprockets/driver`.
pub fn body_entity(body: &BodyInfo) -> EntityPath {
    std::iter::once("bodies")
        .chain(body.path.split('.'))
        .map(rerun::external::re_log_types::EntityPathPart::new)
        .collect()
}

/// Entity of a kind of roller.
pub fn roller_entity(kind: usize) -> EntityPath {
    ["chain".to_string(), format!("rollers {kind}")]
        .into_iter()
        .map(rerun::external::re_log_types::EntityPathPart::new)
        .collect()
}

/// Entity of a kind of link.
pub fn outline_entity(outline: &Outline) -> EntityPath {
    ["chain", &outline.name].into_iter().map(rerun::external::re_log_types::EntityPathPart::new).collect()
}

/// Logs all static data.
pub fn log(stream: &RecordingStream, header: &Header, scale: ForceScale) -> Result<()> {
    stream.log_static("/", &ViewCoordinates::RIGHT_HAND_Y_UP())?;
    for (i, outline) in header.link_outlines.iter().enumerate() {
        stream.log_static(outline_entity(outline), &link_mesh(outline, i, pitch_mm(header)))?;
    }
    for (kind, radii) in header.roller_radii().into_iter().enumerate() {
        stream.log_static(roller_entity(kind), &roller_mesh(radii, pitch_mm(header)))?;
    }
    for body in &header.bodies {
        log_body(stream, body, pitch_mm(header))?;
    }
    log_styles(stream, header, scale)?;
    log_curve_names(stream, header)?;
    stream.log_static("readme", &TextDocument::from_markdown(readme(header, scale)))?;
    stream.log_static("drive_file", &TextDocument::new(header.drive_text.as_str()))?;
    Ok(())
}

fn link_mesh(outline: &Outline, row: usize, pitch_mm: f64) -> Mesh3D {
    let (z, rim, face, disc) = match row {
        0 => (Z_INNER, [52, 74, 110], [104, 142, 196], [60, 84, 124]),
        1 => (Z_OUTER, [112, 78, 30], [214, 164, 84], [128, 92, 40]),
        _ => (Z_INNER, [60, 90, 60], [120, 170, 120], [66, 96, 66]),
    };
    let points = polyline(outline);
    let centre = centroid(&points);
    let inset: Vec<[f64; 2]> = points.iter().map(|p| [0, 1].map(|k| centre[k] + 0.94 * (p[k] - centre[k]))).collect();
    let mut mesh = MeshParts { pitch_mm, ..MeshParts::default() };
    mesh.push_fan(centre, &points, z, rim);
    mesh.push_fan(centre, &inset, z + Z_FACE, face);
    for c in &outline.circles {
        mesh.push_fan([c.x_m, c.y_m], &circle(c.x_m, c.y_m, c.radius_m), z + Z_DISC, disc);
    }
    mesh.build()
}

/// A roller, and the bush in its bore, in front of the plates between which they lie.
fn roller_mesh([radius_m, bore_m]: [f64; 2], pitch_mm: f64) -> Mesh3D {
    let mut mesh = MeshParts { pitch_mm, ..MeshParts::default() };
    mesh.push_fan([0.0, 0.0], &circle(0.0, 0.0, radius_m), Z_OUTER + 1.35 * Z_FACE, [196, 188, 120]);
    mesh.push_fan([0.0, 0.0], &circle(0.0, 0.0, bore_m), Z_OUTER + 1.7 * Z_FACE, [52, 60, 84]);
    mesh.build()
}

/// Contour, spokes that show the rotation, and a filled face if the contour is star-shaped about its centre.
fn log_body(stream: &RecordingStream, body: &BodyInfo, pitch_mm: f64) -> Result<()> {
    let entity = body_entity(body);
    if !body.moves() {
        stream.log_static(entity.clone(), &standing_transform(body))?;
    }
    let Some(outline) = &body.outline else { return Ok(()) };
    let points = polyline(outline);
    let z_mm = (Z_OUTLINE * pitch_mm) as f32;
    // A ball is a circle alone.
    let contour = Some(&points).filter(|points| !points.is_empty());
    let mut strips: Vec<_> = contour.map(|points| strip(points, outline.closed, z_mm)).into_iter().collect();
    strips.extend(outline.circles.iter().map(|c| strip(&circle(c.x_m, c.y_m, c.radius_m), true, z_mm)));
    if body.rotor {
        let hub = points.iter().map(|p| libm::hypot(p[0], p[1])).fold(f64::INFINITY, f64::min);
        strips.push(strip(&[[0.25 * hub, 0.0], [0.9 * hub, 0.0]], false, z_mm));
    }
    let line_mm = (0.02 * pitch_mm) as f32;
    let colour = if body.rotor { Color::from_rgb(235, 235, 235) } else { Color::from_rgb(120, 200, 140) };
    stream.log_static(entity.clone(), &LineStrips3D::new(strips).with_radii([line_mm]).with_colors([colour]))?;
    let centre = if body.rotor { [0.0, 0.0] } else { centroid(&points) };
    if outline.closed && star_shaped(centre, &points) {
        let mut mesh = MeshParts { pitch_mm, ..MeshParts::default() };
        mesh.push_fan(centre, &points, Z_BODY, if body.rotor { [96, 100, 108] } else { [58, 92, 66] });
        stream.log_static(entity, &mesh.build())?;
    }
    Ok(())
}

fn standing_transform(body: &BodyInfo) -> Transform3D {
    let (s, c) = libm::sincos(0.5 * body.angle_rad);
    let [x, y] = [body.x_m, body.y_m].map(|v| (MM_PER_M * v) as f32);
    Transform3D::new()
        .with_translation([x, y, 0.0])
        .with_quaternion(rerun::Quaternion::from_xyzw([0.0, 0.0, s as f32, c as f32]))
}

fn strip(points: &[[f64; 2]], closed: bool, z_mm: f32) -> Vec<[f32; 3]> {
    let ends = if closed { points.first() } else { None };
    points.iter().chain(ends).map(|p| position_mm(*p, z_mm)).collect()
}

/// Converts a point [m] to the drawing [mm].
pub fn position_mm(point_m: [f64; 2], z_mm: f32) -> [f32; 3] {
    [(MM_PER_M * point_m[0]) as f32, (MM_PER_M * point_m[1]) as f32, z_mm]
}

/// Area centroid of a polygon.
fn centroid(points: &[[f64; 2]]) -> [f64; 2] {
    let (mut area, mut x, mut y) = (0.0, 0.0, 0.0);
    for (a, b) in edges(points) {
        let cross = a[0] * b[1] - b[0] * a[1];
        area += cross;
        x += cross * (a[0] + b[0]);
        y += cross * (a[1] + b[1]);
    }
    if area == 0.0 { points.first().copied().unwrap_or_default() } else { [x / (3.0 * area), y / (3.0 * area)] }
}

/// Whether a fan of triangles around `centre` covers exactly the polygon.
fn star_shaped(centre: [f64; 2], points: &[[f64; 2]]) -> bool {
    let cross = |(a, b): ([f64; 2], [f64; 2])| {
        (a[0] - centre[0]) * (b[1] - centre[1]) - (b[0] - centre[0]) * (a[1] - centre[1])
    };
    edges(points).all(|e| cross(e) >= 0.0) || edges(points).all(|e| cross(e) <= 0.0)
}

fn edges(points: &[[f64; 2]]) -> impl Iterator<Item = ([f64; 2], [f64; 2])> + '_ {
    points.iter().copied().zip(points.iter().copied().cycle().skip(1))
}

/// A mesh under construction: flat faces towards +z, each of one colour.
#[derive(Default)]
struct MeshParts {
    pitch_mm: f64,
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    colours: Vec<Color>,
}

impl MeshParts {
    fn push_fan(&mut self, centre: [f64; 2], points: &[[f64; 2]], z_pitches: f64, rgb: [u8; 3]) {
        let z_mm = (z_pitches * self.pitch_mm) as f32;
        let first = self.positions.len() as u32;
        let n = points.len() as u32;
        self.positions.push(position_mm(centre, z_mm));
        self.positions.extend(points.iter().map(|p| position_mm(*p, z_mm)));
        self.triangles.extend((0..n).map(|k| [first, first + 1 + k, first + 1 + (k + 1) % n]));
        self.colours.resize(self.positions.len(), Color::from_rgb(rgb[0], rgb[1], rgb[2]));
    }

    fn build(self) -> Mesh3D {
        let normals = vec![[0.0_f32, 0.0, 1.0]; self.positions.len()];
        Mesh3D::new(self.positions)
            .with_triangle_indices(self.triangles)
            .with_vertex_normals(normals)
            .with_vertex_colors(self.colours)
    }
}

/// Sizes and colours of points and arrows, common to all rows.
fn log_styles(stream: &RecordingStream, header: &Header, scale: ForceScale) -> Result<()> {
    let classes = |colour: fn(f64) -> [u8; 3]| {
        let describe = |class: u16| {
            let [r, g, b] = colour((f64::from(class) + 0.5) / f64::from(FORCE_CLASSES));
            let limit_n = scale.class_limit_n(class);
            (class, format!("up to {limit_n:.0} N"), Rgba32::from_rgb(r, g, b))
        };
        let all: Vec<_> = (0..FORCE_CLASSES).map(describe).collect();
        AnnotationContext::new(all.iter().map(|(class, label, colour)| (*class, label.as_str(), *colour)))
    };
    let pitch = pitch_mm(header) as f32;
    let points = |radius: f32| {
        Points3D::update_fields().with_radii([radius]).with_show_labels(false).with_point_shading(PointShading::Flat)
    };
    stream.log_static("contacts/points", &classes(contact_colour))?;
    stream.log_static("contacts/points", &points(0.035 * pitch))?;
    stream.log_static("joints/tension", &classes(tension_colour))?;
    stream.log_static("joints/tension", &points(0.07 * pitch))?;
    let arrows = Arrows3D::update_fields().with_radii([0.018 * pitch]).with_colors([rgb(FORCE)]);
    stream.log_static("contacts/forces", &arrows)?;
    let friction = Arrows3D::update_fields().with_radii([0.014 * pitch]).with_colors([rgb(FRICTION)]);
    stream.log_static("contacts/friction", &friction)?;
    let labels = Points3D::update_fields()
        .with_radii([0.001 * pitch])
        .with_colors([Color::from_rgb(255, 255, 255)])
        .with_show_labels(true);
    stream.log_static("contacts/labels", &labels)?;
    let page = TextDocument::update_fields().with_media_type(MediaType::markdown());
    stream.log_static(CONTACTS_PAGE, &page)?;
    Ok(())
}

/// A colour of three bytes.
fn rgb([r, g, b]: [u8; 3]) -> Color {
    Color::from_rgb(r, g, b)
}

/// Sizes of a legend, as shares of the height of its picture: distances of its rows, columns and edges, and radius of its dots.
const LEGEND_ROW: f64 = 0.05;
const LEGEND_COLUMN: f64 = 0.17;
/// Further room beside the first column, whose labels have words.
const LEGEND_WORDS: f64 = 0.08;
const LEGEND_EDGE: f64 = 0.13;
const LEGEND_DOT: f64 = 0.008;
/// Forces whose colours a legend shows, as multiples of the one in the middle of the scale.
const LEGEND_FORCES: [f64; 4] = [0.0, 0.3, 1.0, 3.0];

/// Entity of the legend of a view.
pub fn legend_entity(view: usize) -> String {
    format!("legend/{view}")
}

/// A legend in the lower left corner of a pane of this ratio of width to height: an arrow of a round force, and the colours of pins and contacts.
pub fn log_legend(
    stream: &RecordingStream,
    view: usize,
    (look, aspect): (&ViewRect, f64),
    scale: ForceScale,
) -> Result<()> {
    let [half_width, half_height] = look.half_seen(aspect);
    let height = 2.0 * half_height;
    let at = |column: f64, row: f64| {
        let beside_words = if column > 0.0 { LEGEND_WORDS } else { 0.0 };
        let x = look.centre[0] - half_width + (LEGEND_EDGE + beside_words + LEGEND_COLUMN * column) * height;
        let y = look.centre[1] - half_height + (LEGEND_EDGE + LEGEND_ROW * row) * height;
        [x as f32, y as f32, scale.z_mm]
    };
    let entity = |part: &str| format!("{}/{part}", legend_entity(view));
    let arrow_n = round_force_n(scale.middle_n);
    let size = |share: f64| (share * height) as f32;
    let arrow = Arrows3D::from_vectors([[scale.mm_per_n * arrow_n as f32, 0.0, 0.0]])
        .with_origins([at(1.0, 2.0)])
        .with_radii([size(0.4 * LEGEND_DOT)])
        .with_colors([rgb(FORCE)])
        .with_labels([format!("contact force {arrow_n:.0} N, friction blue")])
        .with_show_labels(true);
    stream.log_static(entity("scale"), &arrow)?;
    for (row, part, words, colour) in [
        (1.0, "tension", "pins: tension", tension_colour as fn(f64) -> [u8; 3]),
        (0.0, "contacts", "contacts", contact_colour),
    ] {
        let forces = LEGEND_FORCES.map(|multiple| multiple * scale.middle_n);
        let colours = forces.map(|n| {
            let share = (f64::from(scale.class(n)) + 0.5) / f64::from(FORCE_CLASSES);
            rgb(colour(share))
        });
        let labels = forces.map(|n| if n == 0.0 { format!("{words} 0 N") } else { format!("{n:.0} N") });
        let points = Points3D::new((0..LEGEND_FORCES.len()).map(|column| at(column as f64, row)))
            .with_radii([size(LEGEND_DOT)])
            .with_colors(colours)
            .with_labels(labels)
            .with_show_labels(true)
            .with_point_shading(PointShading::Flat);
        stream.log_static(entity(part), &points)?;
    }
    Ok(())
}

/// The largest of 1, 2, 5, 10, ... that is not above a force [N].
fn round_force_n(force_n: f64) -> f64 {
    let decade = libm::pow(10.0, libm::floor(libm::log10(force_n)));
    [5.0, 2.0, 1.0].into_iter().map(|step| step * decade).find(|round| *round <= force_n).unwrap_or(decade)
}

/// Yellow to red with increasing force.
fn contact_colour(share: f64) -> [u8; 3] {
    blend(share, &[[255, 250, 170], [255, 190, 40], [240, 60, 30], [190, 0, 90]])
}

/// White (slack) through green and yellow to red (tight).
fn tension_colour(share: f64) -> [u8; 3] {
    blend(share, &[[245, 245, 255], [120, 220, 160], [250, 220, 40], [230, 30, 30]])
}

fn blend(share: f64, colours: &[[u8; 3]]) -> [u8; 3] {
    let place = share.clamp(0.0, 1.0) * (colours.len() - 1) as f64;
    let k = (place as usize).min(colours.len() - 2);
    let part = place - k as f64;
    [0, 1, 2].map(|c| (f64::from(colours[k][c]) * (1.0 - part) + f64::from(colours[k + 1][c]) * part) as u8)
}

/// Indices of the sensors of each unit: curves of one unit share an axis.
pub fn sensors_by_unit(header: &Header) -> Vec<(String, Vec<usize>)> {
    let mut all: Vec<(String, Vec<usize>)> = Vec::new();
    for (k, sensor) in header.sensors.iter().enumerate() {
        match all.iter_mut().find(|(unit, _)| *unit == sensor.unit) {
            Some((_, own)) => own.push(k),
            None => all.push((sensor.unit.clone(), vec![k])),
        }
    }
    all
}

/// The entity with the curves of the sensors of a unit.
pub fn sensors_entity(unit: &str) -> String {
    let word: String = unit.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    format!("plots/sensors/{word}")
}

/// Curves of contact forces by their names, and the curve of each body: one for each sprocket and one for all else. In a merged recording every
/// drive has one.
pub fn force_curves(header: &Header) -> (Vec<String>, Vec<usize>) {
    let drives = drives_of(header);
    if !drives.is_empty() {
        let of_drive = |body: &BodyInfo| drives.iter().position(|d| drive_of(body) == Some(d)).unwrap_or(0);
        return (drives.iter().map(|d| (*d).to_string()).collect(), header.bodies.iter().map(of_drive).collect());
    }
    let rotors = || header.bodies.iter().filter(|body| body.rotor);
    let mut names: Vec<String> = rotors().map(short_name).collect();
    let others = names.len();
    if header.bodies.len() > others {
        names.push("guides".to_string());
    }
    let curve = |(i, body): (usize, &BodyInfo)| if body.rotor { i } else { others };
    (names, header.bodies.iter().enumerate().map(curve).collect())
}

/// Entities of the peaks of impacts: one for each curve of contact forces.
pub fn peaks_entities(header: &Header) -> Vec<String> {
    (0..force_curves(header).0.len()).map(|curve| format!("{IMPACT_PEAKS}/{curve}")).collect()
}

/// Names of the curves, in the order in which the sink writes them.
fn log_curve_names(stream: &RecordingStream, header: &Header) -> Result<()> {
    let forces = force_curves(header).0.into_iter().map(|name| format!("{name} [N]"));
    let named = |names: Vec<String>| {
        let colours = CURVE_COLOURS.iter().cycle().map(|[r, g, b]| Color::from_rgb(*r, *g, *b));
        SeriesLines::new().with_colors(colours.take(names.len())).with_names(names)
    };
    let forces: Vec<String> = forces.collect();
    let colours = CURVE_COLOURS.iter().cycle().map(|[r, g, b]| Color::from_rgb(*r, *g, *b));
    for ((entity, name), colour) in peaks_entities(header).into_iter().zip(&forces).zip(colours) {
        let peaks = SeriesPoints::new().with_colors([colour]).with_marker_sizes([PEAK_MARK]);
        stream.log_static(entity, &peaks.with_names([format!("peaks of impacts, {name}")]))?;
    }
    stream.log_static("plots/largest_contact_force", &named(forces))?;
    stream.log_static("plots/joint_tension", &named(vec!["largest [N]".to_owned(), "smallest [N]".to_owned()]))?;
    let turning = header.coordinates.iter().map(|path| {
        ["elastic_shafts.", "effects."]
            .iter()
            .find_map(|own| path.strip_prefix(own))
            .unwrap_or_else(|| crate::diag::last_name(path))
    });
    stream.log_static("plots/speed", &named(turning.map(|name| format!("{name} [1/min]")).collect()))?;
    for (unit, sensors) in sensors_by_unit(header) {
        let name = |k: &usize| format!("{} [{unit}]", header.sensors[*k].path.trim_start_matches("sensors."));
        stream.log_static(sensors_entity(&unit), &named(sensors.iter().map(name).collect()))?;
    }
    stream.log_static("plots/contacts", &named(vec!["contacts".to_owned()]))?;
    stream.log_static("plots/energy_error", &named(vec!["energy error [J]".to_owned()]))?;
    let accounts = |is_meant: fn(ColumnKind) -> bool| {
        let columns = Energy::MESSAGE.columns.iter().filter(|account| is_meant(account.kind));
        named(columns.map(|account| format!("{} [{}]", account.words(), account.unit)).collect())
    };
    stream.log_static("plots/energy", &accounts(is_energy_or_work))?;
    stream.log_static("plots/energy_lost", &accounts(is_lost))?;
    Ok(())
}

fn readme(header: &Header, scale: ForceScale) -> String {
    let Header { program, drive_name, overrides, step_s, steps_per_frame, assembly, .. } = header;
    let frame_s = step_s * *steps_per_frame as f64;
    let mut text = format!(
        "# {drive_name}\n\nWritten by {program}. Step {:.3} us, one frame every {:.1} us.\n\n\
         Numbers are SI (m, N, rad, s) with 7 digits; the drawing is in millimetres.\n\n\
         | where | what |\n|---|---|\n\
         | `chain`, `bodies` | links (blue: inner, brown: outer), sprockets, guides, arms, plungers |\n\
         | `joints/tension` | pins, coloured by tension: white slack, green, yellow, red tight |\n\
         | `contacts/points` | where links touch sprockets and guides, and plungers their arms; yellow to red with the force |\n\
         | `contacts/forces` | force on the link, or of an arm on its plunger, {:.3} mm per N: the static tension {:.1} N is 1.5 pitches long |\n\
         | `contacts/friction` | its part by friction, in the same scale |\n\
         | `contacts/labels` | link, gap or guide, and force, of contacts that are large or have just begun |\n\
         | `tables/contacts` | the largest contacts, a row each, one page a picture |\n\
         | `state/contacts` | all numbers of all contacts, one row a frame |\n\
         | `state/rotors`, `state/sliders`, `state/touches` | angles, ways, speeds, forces and torques of what turns and slides, one row a frame |\n\
         | `state/links`, `state/joints` | poses, speeds, accelerations and forces, one row a picture |\n\
         | `state/chambers`, `state/passages` | pressures and flows of oil, one row a frame |\n\
         | `plots` | curves |\n| `events` | what happened when |\n\n\
         Timelines: `sim_time`, `step`, `crank_angle` (driver's turn in micro-degrees). \
         Curves, contacts and rotors are there for every frame; the drawing, links and joints are held from one picture to the next.\n",
        step_s * 1e6,
        frame_s * 1e6,
        scale.mm_per_n,
        header.static_tension_n,
    );
    push_list(&mut text, "Overrides", overrides);
    push_list(&mut text, "Assembly", assembly);
    text.push_str("\n## Columns\n\n| column | unit | meaning |\n|---|---|---|\n");
    for channel in &header.channels {
        text.push_str(&format!("| `{}` | {} | {} |\n", channel.name, channel.unit, channel.meaning));
    }
    text
}

fn push_list(text: &mut String, title: &str, lines: &[String]) {
    if lines.is_empty() {
        return;
    }
    text.push_str(&format!("\n## {title}\n\n"));
    for line in lines {
        text.push_str(&format!("- `{line}`\n"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: [[f64; 2]; 4] = [[1.0, 1.0], [3.0, 1.0], [3.0, 3.0], [1.0, 3.0]];

    #[test]
    fn fans_are_drawn_only_where_they_cover_the_shape() {
        assert_eq!(centroid(&SQUARE), [2.0, 2.0]);
        assert!(star_shaped([2.0, 2.0], &SQUARE));
        assert!(!star_shaped([4.0, 2.0], &SQUARE));
    }

    #[test]
    fn the_static_tension_has_the_middle_colour() {
        let scale = ForceScale::new(&Header { static_tension_n: 50.0, ..Header::default() });
        assert_eq!(scale.class(50.0), FORCE_CLASSES / 2);
        assert_eq!(scale.class(0.0), 0);
        assert_eq!(scale.class(1e12), FORCE_CLASSES - 1);
        assert_eq!(scale.class_limit_n(FORCE_CLASSES / 2 - 1), 50.0);
    }
}
