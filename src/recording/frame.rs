//! What a recording holds: one [`Header`] and many [`Frame`]s.
//!
//! Both are protobuf messages (`assets/pitchline.proto` is their stable schema; a test holds the two together). All values
//! are SI and f64; columns run in chain order, so that `links.x_m[i]` belongs to link `i`. A Frame is complete: nobody who
//! reads it has to ask the model. A column, an account of the ledger, or a field of an impact is one row below (see
//! [`super::columns`]); where it is computed, `capture.rs` fills it.

use super::columns::schema::{derived, double, double40, double48, float, string, uint32, uint64};
use super::columns::{
    Column, ColumnKind, ColumnValues, FINE_TAG, Holds, MessageInfo, Rows, Stored, TableInfo, ValuesMut, columns_of,
    record, tables,
};
use super::frame_bytes;

/// Version of the recording's layout. A reader refuses others and says so: docs/recording-format.md lists what differs.
pub const FORMAT_VERSION: u32 = 4;

/// `Contacts::body` of frames index into [`Header::bodies`].
#[derive(Clone, PartialEq, prost::Message)]
pub struct Header {
    /// [`FORMAT_VERSION`] of the writer.
    #[prost(uint32, tag = "1")]
    pub format_version: u32,
    /// Program and version that wrote the recording.
    #[prost(string, tag = "2")]
    pub program: String,
    /// Name of the drive: bundled name or file name.
    #[prost(string, tag = "3")]
    pub drive_name: String,
    /// The drive file, as read.
    #[prost(string, tag = "4")]
    pub drive_text: String,
    /// `path=value` overrides, in the order given.
    #[prost(string, repeated, tag = "5")]
    pub overrides: Vec<String>,
    /// Integration step [s].
    #[prost(double, tag = "6")]
    pub step_s: f64,
    /// Steps between two frames.
    #[prost(uint64, tag = "7")]
    pub steps_per_frame: u64,
    /// Links of the chain in chain order.
    #[prost(message, repeated, tag = "8")]
    pub links: Vec<LinkInfo>,
    /// Outlines that links refer to: inner, outer.
    #[prost(message, repeated, tag = "9")]
    pub link_outlines: Vec<Outline>,
    /// Sprockets first (in the order of `Rotors`), then guides, then rails; behind them what no chain touches: arms, sliders and their
    /// housings, check balls.
    #[prost(message, repeated, tag = "10")]
    pub bodies: Vec<BodyInfo>,
    /// Unit and meaning of every column.
    #[prost(message, repeated, tag = "11")]
    pub channels: Vec<Channel>,
    /// Nominal chain speed z p n [m/s] and mean static tension [N], for scaling of pictures and reports.
    #[prost(double, tag = "12")]
    pub chain_speed_m_s: f64,
    /// Mean tension of the assembled loop at rest [N].
    #[prost(double, tag = "13")]
    pub static_tension_n: f64,
    /// How the drive was assembled, as `key = value unit` lines.
    #[prost(string, repeated, tag = "14")]
    pub assembly: Vec<String>,
    /// The recording that this one goes on from, or was cut out of.
    #[prost(message, optional, tag = "15")]
    pub parent: Option<Parent>,
    /// All energies when the ledger was opened; frames count losses and work from there.
    #[prost(message, optional, tag = "16")]
    pub ledger_origin: Option<Energy>,
    /// Sensors of the drive, in the order of `Frame::sensors`.
    #[prost(message, repeated, tag = "17")]
    pub sensors: Vec<SensorInfo>,
    /// Paths in the drive file of the rows of `Rotors`: sprockets first, then arms.
    #[prost(string, repeated, tag = "18")]
    pub coordinates: Vec<String>,
    /// Paths of the rows of `Sliders`: sliders, check balls by their passages, the ways of bearings, guides and rails on mounts, the modes of blades.
    #[prost(string, repeated, tag = "19")]
    pub sliders: Vec<String>,
    /// Paths of the rows of `Touches`: a part, and what of it touches.
    #[prost(string, repeated, tag = "20")]
    pub touches: Vec<String>,
    /// Paths of the rows of `Chambers`: chambers, then reservoirs.
    #[prost(string, repeated, tag = "21")]
    pub chambers: Vec<String>,
    /// Paths of the rows of `Passages`.
    #[prost(string, repeated, tag = "22")]
    pub passages: Vec<String>,
    /// Rollers that are bodies of their own, in the order of `Rollers`.
    #[prost(message, repeated, tag = "23")]
    pub rollers: Vec<RollerInfo>,
    /// Paths of the rows of `Spans`: a chain, and the sprockets that the span leaves and reaches.
    #[prost(string, repeated, tag = "24")]
    pub spans: Vec<String>,
}

impl Header {
    /// Links of every chain: a chain ends with the link that leads back to its first.
    pub fn chains(&self) -> Vec<std::ops::Range<usize>> {
        let (mut chains, mut first) = (Vec::new(), 0);
        for (i, link) in self.links.iter().enumerate() {
            if link.ahead as usize <= i {
                chains.push(first..i + 1);
                first = i + 1;
            }
        }
        chains
    }

    /// Radii of the rollers, and of their bores, each pair once [m].
    pub fn roller_radii(&self) -> Vec<[f64; 2]> {
        let mut radii: Vec<[f64; 2]> = Vec::new();
        for r in &self.rollers {
            let own = [r.radius_m, r.bore_radius_m];
            if !radii.contains(&own) {
                radii.push(own);
            }
        }
        radii
    }

    /// Paths in the drive file of what has a row in a table; None where rows have none.
    pub fn row_paths(&self, rows: Rows) -> Option<&[String]> {
        match rows {
            Rows::Link | Rows::Joint | Rows::Roller | Rows::Contact => None,
            Rows::Rotor => Some(&self.coordinates),
            Rows::Slider => Some(&self.sliders),
            Rows::Touch => Some(&self.touches),
            Rows::Chamber => Some(&self.chambers),
            Rows::Passage => Some(&self.passages),
            Rows::Span => Some(&self.spans),
        }
    }
}

/// A sensor of the drive.
#[derive(Clone, PartialEq, prost::Message)]
pub struct SensorInfo {
    /// In the drive file: `sensors.KIND.NAME`.
    #[prost(string, tag = "1")]
    pub path: String,
    /// SI unit of its reading.
    #[prost(string, tag = "2")]
    pub unit: String,
}

/// Where a recording begins that did not begin with an assembled drive.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Parent {
    /// File name of the recording it comes from.
    #[prost(string, tag = "1")]
    pub recording: String,
    /// Its State where this one begins, before anything was changed.
    #[prost(uint64, tag = "2")]
    pub step: u64,
    /// Time of that step [s].
    #[prost(double, tag = "3")]
    pub t_s: f64,
    /// XXH3-64 of its State there.
    #[prost(fixed64, tag = "4")]
    pub state_hash: u64,
    /// True: values of the drive were changed there; a branch of its own.
    #[prost(bool, tag = "5")]
    pub changed: bool,
}

/// A contour of arcs and lines in its body's own frame, and the circles that are drawn with it.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Outline {
    /// `inner`, `outer`, or the path of the body.
    #[prost(string, tag = "1")]
    pub name: String,
    /// Exact elements in order.
    #[prost(message, repeated, tag = "2")]
    pub elements: Vec<OutlineElement>,
    /// Whether the last element ends where the first begins.
    #[prost(bool, tag = "3")]
    pub closed: bool,
    /// Extra circles (bushes, pins, bores): x, y, radius [m].
    #[prost(message, repeated, tag = "4")]
    pub circles: Vec<OutlineCircle>,
}

/// A line from start to end, or an arc round `centre` when `radius_m` > 0.
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub struct OutlineElement {
    /// x of the start [m].
    #[prost(double, tag = "1")]
    pub start_x_m: f64,
    /// y of the start [m].
    #[prost(double, tag = "2")]
    pub start_y_m: f64,
    /// x of the end [m].
    #[prost(double, tag = "3")]
    pub end_x_m: f64,
    /// y of the end [m].
    #[prost(double, tag = "4")]
    pub end_y_m: f64,
    /// x of the centre of an arc [m].
    #[prost(double, tag = "5")]
    pub centre_x_m: f64,
    /// y of the centre of an arc [m].
    #[prost(double, tag = "6")]
    pub centre_y_m: f64,
    /// Radius of an arc; 0 of a line [m].
    #[prost(double, tag = "7")]
    pub radius_m: f64,
    /// Signed sweep of the arc [rad], counterclockwise positive.
    #[prost(double, tag = "8")]
    pub sweep_rad: f64,
}

/// A circle of an outline.
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub struct OutlineCircle {
    /// x of the centre [m].
    #[prost(double, tag = "1")]
    pub x_m: f64,
    /// y of the centre [m].
    #[prost(double, tag = "2")]
    pub y_m: f64,
    /// Radius [m].
    #[prost(double, tag = "3")]
    pub radius_m: f64,
}

/// What a body is (`BodyInfo::kind`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum BodyKind {
    /// A toothed wheel that a chain runs on.
    Sprocket = 0,
    /// A straight guide.
    Guide = 1,
    /// A guide of arcs and lines; on an arm it turns with it.
    Rail = 2,
    /// What carries a rail about its pivot, without the rail.
    Arm = 3,
    /// A plunger.
    Slider = 4,
    /// What a plunger slides in.
    Housing = 5,
    /// The ball of a check valve.
    Ball = 6,
    /// A chain without links, on its pitch line.
    Chain = 7,
    /// A cam on a shaft.
    Cam = 8,
    /// A valve with its follower.
    Valve = 9,
}

impl BodyKind {
    /// Names in the order of the numbers.
    pub const NAMES: [&str; 10] =
        ["sprocket", "guide", "rail", "arm", "slider", "housing", "ball", "chain", "cam", "valve"];

    /// In words, of a `BodyInfo::kind`.
    pub fn name(kind: u32) -> &'static str {
        Self::NAMES.get(kind as usize).copied().unwrap_or("body")
    }
}

/// One of the ways by which a bearing shifts a body.
#[derive(Clone, PartialEq, prost::Message)]
pub struct BodyShift {
    /// Row in `Sliders`: the way.
    #[prost(uint32, tag = "1")]
    pub slider: u32,
    /// Its direction in the world, x.
    #[prost(double, tag = "2")]
    pub direction_x: f64,
    /// Its direction in the world, y.
    #[prost(double, tag = "3")]
    pub direction_y: f64,
}

/// A sprocket, a guide, or another part that is drawn.
#[derive(Clone, PartialEq, prost::Message)]
pub struct BodyInfo {
    /// Path in the drive file, e.g. `sprockets.driver`.
    #[prost(string, tag = "1")]
    pub path: String,
    /// True: a sprocket, with the same place in `Rotors` as here.
    #[prost(bool, tag = "2")]
    pub rotor: bool,
    /// Origin of the body's frame [m]; a sprocket's axis.
    #[prost(double, tag = "3")]
    pub x_m: f64,
    /// y of the origin of the body's frame [m].
    #[prost(double, tag = "4")]
    pub y_m: f64,
    /// Rotation of a guide's frame [rad]; of what turns, at angle zero. What slides moves along the x-axis of its frame.
    #[prost(double, tag = "5")]
    pub angle_rad: f64,
    /// Number of teeth; 0 for all but sprockets.
    #[prost(uint32, tag = "6")]
    pub teeth: u32,
    /// Its whole contour.
    #[prost(message, optional, tag = "7")]
    pub outline: Option<Outline>,
    /// Row in `Rotors` of what it turns by; absent where it does not turn.
    #[prost(uint32, optional, tag = "8")]
    pub coordinate: Option<u32>,
    /// Row in `Sliders` of what it moves by; absent where it does not slide.
    #[prost(uint32, optional, tag = "9")]
    pub slider: Option<u32>,
    /// What shifts it beside that: the ways of its bearing.
    #[prost(message, repeated, tag = "13")]
    pub shifts: Vec<BodyShift>,
    /// A [`BodyKind`].
    #[prost(uint32, tag = "10")]
    pub kind: u32,
    /// Lower end of its way [rad, m]; absent where it has no stop there.
    #[prost(double, optional, tag = "11")]
    pub low_stop: Option<f64>,
    /// Upper end of its way [rad, m]; absent where it has no stop there.
    #[prost(double, optional, tag = "12")]
    pub high_stop: Option<f64>,
}

/// Share of a peak from which on its rise is measured. A force that has more than that at the touch itself rises as fast as its law says.
pub const RISE_FROM_SHARE: f64 = 0.1;

impl Impact {
    /// Time of the touch itself [s].
    pub fn touched_s(&self) -> f64 {
        self.t_s + self.touch_offset_s
    }

    /// Rise time [s]; None where it is the contact law's, whose force jumps at the touch.
    pub fn own_rise_time_s(&self) -> Option<f64> {
        (self.touch_force_n <= RISE_FROM_SHARE * self.peak_force_n).then_some(self.rise_time_s)
    }
}

impl BodyInfo {
    /// Whether it turns or slides.
    pub fn moves(&self) -> bool {
        self.coordinate.is_some() || self.slider.is_some() || !self.shifts.is_empty()
    }

    /// Where its frame stands in a frame of the recording: origin [m], and rotation [rad].
    pub fn pose(&self, frame: &Frame) -> ([f64; 2], f64) {
        let at = |row: Option<u32>, column: &[f64]| row.and_then(|k| column.get(k as usize)).copied();
        let turned_rad = at(self.coordinate, &frame.rotors.angle_rad).unwrap_or(0.0);
        let mut origin = match at(self.slider, &frame.sliders.position_m) {
            None => [self.x_m, self.y_m],
            Some(way_m) => {
                let (sin, cos) = crate::units::sin_cos(self.angle_rad);
                [self.x_m + way_m * cos, self.y_m + way_m * sin]
            }
        };
        for shift in &self.shifts {
            let way_m = at(Some(shift.slider), &frame.sliders.position_m).unwrap_or(0.0);
            origin = [origin[0] + way_m * shift.direction_x, origin[1] + way_m * shift.direction_y];
        }
        (origin, self.angle_rad + turned_rad)
    }
}

/// Name, unit and meaning of one column.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Channel {
    /// e.g. `links.x_m`.
    #[prost(string, tag = "1")]
    pub name: String,
    /// e.g. `m`.
    #[prost(string, tag = "2")]
    pub unit: String,
    /// One sentence.
    #[prost(string, tag = "3")]
    pub meaning: String,
}

tables! {
    /// Pose, velocity and acceleration of every link at its centre of mass.
    5 links: Links, a row per Link {
        1 x_m: double48, "m", Node, Value, "Centre of mass, x.";
        2 y_m: double48, "m", Node, Height, "Centre of mass, y.";
        3 angle_rad: double48, "rad", Node, Value, "Heading of the link, rear pin to front pin, in [-pi, pi].";
        4 vx_m_s: float, "m/s", Node, Value, "Velocity of the centre of mass, x.";
        5 vy_m_s: float, "m/s", Node, Value, "Velocity of the centre of mass, y.";
        6 omega_rad_s: float, "rad/s", Node, Value, "Angular velocity, counterclockwise positive.";
        7 ax_m_s2: double40, "m/s2", Step, Value, "Acceleration of the centre of mass, x; mean over the step.";
        8 ay_m_s2: double40, "m/s2", Step, Value, "Acceleration of the centre of mass, y; mean over the step.";
        9 alpha_rad_s2: double40, "rad/s2", Step, Value, "Angular acceleration, counterclockwise positive; mean over the step.";
    }

    /// Joint `j` joins the front end of link `j` to the rear end of the link ahead (`LinkInfo.ahead`).
    6 joints: Joints, a row per Joint {
        1 force_x_n: double48, "N", Step, Value, "Force on link `j + 1` at joint `j`, mean over the step; link `j` feels the opposite.";
        2 force_y_n: double48, "N", Step, Value, "As force_x_n, y.";
        3 friction_torque_nm: double40, "N m", Step, Value, "Friction torque on link `j + 1`; mean over the step.";
    }

    /// All contacts that overlap at the instant or push within the step, sorted by link, feature, body.
    7 contacts: Contacts, a row per Contact {
        1 link: uint32, "1", Node, Link, "Index of the link.";
        2 feature: uint32, "1", Node, Feature, "The part of the link that touches: 0 rear bush, 1 front bush, 2 rear plate end, 3 front plate end, 4 rear abutment, 5 front abutment, 6 trailing flank, 7 leading flank, 8 rear inner flank, 9 front inner flank, 10 plate edge; 11 rear and 12 front roller, which the force acts on instead of the link.";
        3 body: uint32, "1", Node, Body, "Index into `Header::bodies`.";
        4 tooth: uint32, "1", Node, Value, "Tooth gap of a sprocket, counted counterclockwise from its mark; 0 on a guide.";
        5 segment: uint32, "1", Node, Segment, "Element of the body: 0 seat, 1 and 2 flank on the clockwise and counterclockwise side of the gap, 3 tip corner, 4 tip land, 5 guide face, 6 and 7 its lead-in and lead-out, 8 ring, 9 arc and 10 end of a rail.";
        6 point_body_x_m: derived, "m", Node, Value, "Foot of the contact on the body's contour: point_link + normal x penetration.";
        7 point_body_y_m: derived, "m", Node, Height, "Foot of the contact on the body's contour, y.";
        8 point_link_x_m: double48, "m", Node, Value, "Deepest point of the link's contour.";
        9 point_link_y_m: double48, "m", Node, Height, "Deepest point of the link's contour, y.";
        10 normal_x: double48, "1", Node, Value, "Unit normal out of the body, towards the link.";
        11 normal_y: double48, "1", Node, Value, "Unit normal out of the body, y.";
        12 penetration_m: float, "m", Node, Value, "Depth of overlap along the normal at the instant; negative where the contact pushes within the step only.";
        13 approach_speed_m_s: float, "m/s", Node, Value, "Closing speed along the normal when the contact was first touched; foreseen while the penetration is negative.";
        14 normal_speed_m_s: float, "m/s", Node, Value, "Rate of penetration at the instant.";
        15 tangential_speed_m_s: float, "m/s", Step, Value, "Sliding speed of the link over the body along the tangent (normal turned by +90 degrees) that friction works with.";
        16 normal_force_n: double48, "N", Step, Value, "Force on the link along the normal, never negative; mean over the step.";
        17 tangential_force_n: double48, "N", Step, Value, "Friction force on the link along the tangent; mean over the step.";
        18 stick: bool, "1", Step, Value, "True while the friction is below its limit.";
        19 age_s: float, "s", Node, Value, "Time since first touch.";
        20 instant_force_n: float, "N", Node, Value, "What the contact law gives at the instant, never negative.";
    }

    /// One row per coordinate that turns, in the order of `Header::coordinates`: sprockets and shafts, then arms, then shafts without sprockets.
    8 rotors: Rotors, a row per Rotor {
        1 angle_rad: double, "rad", Node, Value, "Angle turned since step 0 plus the angle at assembly.";
        2 speed_rad_s: double, "rad/s", Node, Value, "Angular velocity, counterclockwise positive.";
        3 chain_torque_nm: double, "N m", Step, Value, "Torque of the chain on the sprocket or arm; mean over the step.";
        4 outer_torque_nm: double, "N m", Step, Value, "Torque of drive, loads, spring, damper, couplings and touching parts on it; mean over the step.";
    }

    /// One row per coordinate that slides, in the order of `Header::sliders`: sliders, check balls, ways of bearings, modes of blades.
    11 sliders: Sliders, a row per Slider {
        1 position_m: double, "m", Node, Value, "Way from where it is drawn, outwards positive; of a check ball its lift.";
        2 speed_m_s: double, "m/s", Node, Value, "Speed along its way.";
        3 acceleration_m_s2: double, "m/s2", Step, Value, "Acceleration along its way; mean over the step.";
        4 spring_force_n: double, "N", Step, Value, "Force of its spring, damper, film and loads on it, outwards positive; mean over the step.";
        5 oil_force_n: double, "N", Step, Value, "Force of the oil on it, outwards positive; mean over the step.";
        6 touch_force_n: double, "N", Step, Value, "Force of all that it touches but chains, along its way, outwards positive; mean over the step.";
        7 chain_force_n: double, "N", Step, Value, "Force of chains on what its bearing or its blade carries, along its way; mean over the step.";
    }

    /// One row per pair of parts that may touch each other and no chain, in the order of `Header::touches`: tips of sliders on arms, stops, balls on their seats, cams on followers.
    12 touches: Touches, a row per Touch {
        1 gap_m: double, "m", Node, Value, "Distance of the two; negative where they overlap.";
        2 normal_force_n: double, "N", Step, Value, "Force that parts them, never negative; mean over the step.";
        3 tangential_force_n: double, "N", Step, Value, "Friction force on the first part along the normal turned by +90 degrees; mean over the step.";
        4 approach_speed_m_s: double, "m/s", Node, Value, "Closing speed when they first touched.";
        5 age_s: double, "s", Node, Value, "Time since first touch; 0 while they are apart.";
        6 x_m: double, "m", Node, Value, "Where a tip is nearest to its arm, x; 0 of a stop.";
        7 y_m: double, "m", Node, Height, "Where a tip is nearest to its arm, y; 0 of a stop.";
        8 normal_x: double, "1", Node, Value, "Unit normal there out of the arm, towards the slider; 0 of a stop.";
        9 normal_y: double, "1", Node, Value, "Unit normal there, y; 0 of a stop.";
    }

    /// One row per volume of oil, in the order of `Header::chambers`: chambers, then reservoirs.
    13 chambers: Chambers, a row per Chamber {
        1 pressure_pa: double, "Pa", Node, Value, "Gauge pressure.";
        2 volume_m3: double, "m3", Node, Value, "Volume of a chamber; 0 of a reservoir, which has no bounds.";
        3 inflow_m3_s: double, "m3/s", Node, Value, "Sum of the flows into it through passages.";
    }

    /// One row per passage of oil, in the order of `Header::passages`.
    14 passages: Passages, a row per Passage {
        1 flow_m3_s: double, "m3/s", Node, Value, "Flow from its first end to its second.";
        2 pressure_drop_pa: double, "Pa", Node, Value, "Pressure at its first end less that at its second.";
    }

    /// One row per roller that is a body of its own, in the order of `Header::rollers`: where it is, and what its bush does to it.
    15 rollers: Rollers, a row per Roller {
        1 x_m: double48, "m", Node, Value, "Its axis, x.";
        2 y_m: double48, "m", Node, Height, "Its axis, y.";
        3 vx_m_s: float, "m/s", Node, Value, "Velocity of its axis, x.";
        4 vy_m_s: float, "m/s", Node, Value, "Velocity of its axis, y.";
        5 omega_rad_s: float, "rad/s", Node, Value, "Spin, counterclockwise positive.";
        6 ax_m_s2: double40, "m/s2", Step, Value, "Acceleration of its axis, x; mean over the step.";
        7 ay_m_s2: double40, "m/s2", Step, Value, "Acceleration of its axis, y; mean over the step.";
        8 alpha_rad_s2: double40, "rad/s2", Step, Value, "Angular acceleration, counterclockwise positive; mean over the step.";
        9 force_x_n: double48, "N", Step, Value, "Force of the bush on it, x, mean over the step; the link that carries the bush feels the opposite.";
        10 force_y_n: double48, "N", Step, Value, "As force_x_n, y.";
        11 moment_nm: double48, "N m", Step, Value, "Moment of that force about the axis of the roller; mean over the step.";
        12 bush_moment_nm: double48, "N m", Step, Value, "Moment of the opposite force about the axis of the bush, on its link; mean over the step.";
        13 penetration_m: float, "m", Node, Value, "How deep bush and bore overlap; negative: the play that is left.";
        14 slide_m_s: float, "m/s", Step, Value, "Speed at which the bore slides on the bush.";
    }

    /// One row per span of a chain without link bodies, in the order of `Header::spans`.
    16 spans: Spans, a row per Span {
        1 tension_n: double, "N", Node, Value, "Tension of the links, that of their speed included; never negative.";
        2 elongation_m: double, "m", Node, Value, "What its second sprocket has taken up less what its first has paid out; 0 at the preload.";
        3 power_w: double, "W", Node, Value, "Power that it takes from its first sprocket to its second: preload less tension, times the speed of the chain.";
    }
}

record! {
    /// The ledger: what went in, what went out, what is stored, what was lost, since the first frame; and what does not add up.
    #[derive(Copy)]
    energy: Energy {
        1 kinetic_j: double, "J", Node, Kinetic, "Kinetic energy of links, rollers and of all that moves freely: sprockets, shafts, arms, sliders.";
        2 elastic_joint_j: double, "J", Node, Elastic, "Stored in the pin joints.";
        3 elastic_contact_j: double, "J", Node, Elastic, "Stored in contacts with sprockets and guides, and of parts and rollers that touch each other.";
        4 work_in_j: double, "J", Node, WorkIn, "Work of the drives.";
        15 work_oil_j: double, "J", Node, WorkIn, "Work of reservoirs of oil: what flows out of them times its enthalpy.";
        5 work_out_j: double, "J", Node, WorkOut, "Work done on the loads.";
        6 lost_pin_damping_j: double, "J", Node, Lost, "Lost to damping in the joints.";
        7 lost_pin_friction_j: double, "J", Node, Lost, "Lost to friction in the joints.";
        8 lost_contact_damping_j: double, "J", Node, Lost, "Lost to damping at the teeth, of rollers on their bushes, and of parts that touch each other.";
        9 lost_contact_friction_j: double, "J", Node, Lost, "Lost to friction at the teeth, of rollers on their bushes, and of parts that touch each other.";
        10 lost_guide_damping_j: double, "J", Node, Lost, "Lost to damping at guides.";
        11 lost_guide_friction_j: double, "J", Node, Lost, "Lost to friction at guides.";
        13 elastic_spring_j: double, "J", Node, Elastic, "Stored in the springs of arms, sliders, check balls and bearings, and in blades.";
        16 elastic_coupling_j: double, "J", Node, Elastic, "Stored in couplings and in elastic shafts.";
        21 elastic_span_j: double, "J", Node, Elastic, "Stored in spans of chains without links.";
        17 elastic_oil_j: double, "J", Node, Elastic, "Stored in the oil of all chambers.";
        14 lost_spring_damping_j: double, "J", Node, Lost, "Lost in dampers of arms, sliders, bearings and blades, and in films of bearings.";
        18 lost_coupling_damping_j: double, "J", Node, Lost, "Lost in dampers of couplings and of elastic shafts.";
        22 lost_span_damping_j: double, "J", Node, Lost, "Lost in dampers of spans of chains without links.";
        19 lost_load_j: double, "J", Node, Lost, "Lost by friction and drag of loads.";
        20 lost_oil_j: double, "J", Node, Lost, "Lost in passages of oil.";
        12 error_j: double, "J", Node, Error, "work in - work out - lost - change of stored energy.";
    }
}

record! {
    /// Something that happened between frames.
    events: Event {
        1 step: uint64, "1", Node, Value, "Step number; t_s = step x step_s, rounded.";
        2 t_s: double, "s", Node, Value, "Simulated time since the start of the recording.";
        3 kind: string, "1", Node, Value, "What happened, e.g. first_touch.";
        5 link: uint32, "1", Node, Link, "Index of the link.";
        6 body: uint32, "1", Node, Body, "Index of the body, as in `bodies`.";
        7 value: double, "as the text says", Node, Value, "Quantity the event is about, e.g. the approach speed.";
        4 text: string, "1", Node, Value, "One sentence, with numbers and units.";
    }
}

record! {
    /// A part of a link meets a body after it was free of it for two tooth periods.
    #[derive(Copy)]
    impacts: Impact {
        6 step: uint64, "1", Node, Value, "Step of the first touch.";
        7 t_s: double, "s", Node, Value, "Its simulated time.";
        1 link: uint32, "1", Node, Link, "Index of the link.";
        2 feature: uint32, "1", Node, Feature, "The part of the link that touches, as in `contacts`.";
        3 body: uint32, "1", Node, Body, "Index of the body, as in `bodies`.";
        4 tooth: uint32, "1", Node, Value, "Tooth gap of a sprocket; 0 on a guide.";
        5 segment: uint32, "1", Node, Segment, "Element of the body, as in `contacts`.";
        8 approach_speed_m_s: double, "m/s", Node, Value, "Closing speed along the normal at first touch.";
        9 peak_force_n: double, "N", Step, Value, "Largest normal force within two tooth periods.";
        10 peak_after_s: double, "s", Step, Value, "Its time after the first touch.";
        11 impulse_n_s: double, "N s", Step, Value, "Integral of the normal force from the first touch until, after its peak, it has fallen to half of it.";
        12 rise_time_s: double, "s", Step, Value, "From a tenth to nine tenths of the peak.";
        13 second_period_mean_n: double, "N", Step, Value, "Mean normal force over the second tooth period.";
        14 x_m: double, "m", Node, Value, "Place of the first touch on the body, x.";
        15 y_m: double, "m", Node, Height, "Place of the first touch on the body, y.";
        16 watched_s: double, "s", Node, Value, "How long it was watched: less than two tooth periods where the recording ends.";
        17 touch_force_n: double, "N", Node, Value, "What the contact law gives at the touch itself: more than zero where a constant damper stands beside the spring.";
        18 touch_offset_s: double, "s", Node, Value, "How much later than `t_s` the bodies touched, which is between two steps; negative: before it.";
    }
}

record! {
    /// One roller that is a body of its own.
    #[derive(Copy)]
    roller_info: RollerInfo {
        1 joint: uint32, "1", Node, Link, "Index of the joint whose bush carries it.";
        2 link: uint32, "1", Node, Link, "Index of the link that has that bush.";
        3 radius_m: double, "m", Node, Value, "Outside radius.";
        4 bore_radius_m: double, "m", Node, Value, "Radius of its bore.";
        5 mass_kg: double, "kg", Node, Value, "Mass.";
        6 inertia_kg_m2: double, "kg m2", Node, Value, "Moment of inertia about its axis.";
    }
}

record! {
    /// One link: its row and rigid-body data.
    #[derive(Copy)]
    link_info: LinkInfo {
        1 outline: uint32, "1", Node, Value, "Index of the link's outline in `Header::link_outlines`.";
        2 pitch_m: double, "m", Node, Value, "Pin-to-pin distance, unloaded.";
        3 mass_kg: double, "kg", Node, Value, "Mass.";
        4 inertia_kg_m2: double, "kg m2", Node, Value, "Moment of inertia about the centre of mass.";
        5 ahead: uint32, "1", Node, Link, "Index of the link ahead, which its front joint joins it to: chains are closed, each in itself.";
    }
}

/// All messages whose columns stand above.
pub fn messages() -> impl Iterator<Item = MessageInfo> {
    let records = [Energy::MESSAGE, Event::MESSAGE, Impact::MESSAGE, RollerInfo::MESSAGE, LinkInfo::MESSAGE];
    TABLES.iter().map(|table| table.message).chain(records)
}

/// All columns of a frame's tables, then the accounts of the ledger.
pub fn channels() -> impl Iterator<Item = &'static Column> {
    TABLES.iter().map(|table| table.message).chain([Energy::MESSAGE]).flat_map(|message| message.columns)
}

impl Frame {
    /// Computes the columns that are not stored.
    pub fn derive(&mut self) {
        let c = &mut self.contacts;
        let foot = |foot: &mut Vec<f64>, tip: &[f64], normal: &[f64], depth: &[f64]| {
            foot.clear();
            foot.extend(tip.iter().zip(normal).zip(depth).map(|((tip, normal), depth)| tip + normal * depth));
        };
        foot(&mut c.point_body_x_m, &c.point_link_x_m, &c.normal_x, &c.penetration_m);
        foot(&mut c.point_body_y_m, &c.point_link_y_m, &c.normal_y, &c.penetration_m);
    }

    /// All values by the names of their channels, but the hash of the State.
    pub fn columns(&self) -> Vec<(&'static str, ColumnValues<'_>)> {
        let one = std::slice::from_ref;
        let mut columns = vec![
            ("sensors", ColumnValues::F64(&self.sensors)),
            ("step", ColumnValues::U64(std::slice::from_ref(&self.step))),
            ("t_s", ColumnValues::F64(one(&self.t_s))),
            ("crank_angle_rad", ColumnValues::F64(one(&self.crank_angle_rad))),
        ];
        self.each_table(|table, values| {
            columns.extend(table.message.columns.iter().map(|c| c.channel).zip(values.iter().copied()));
        });
        columns.extend(Energy::MESSAGE.columns.iter().map(|c| c.channel).zip(self.energy.values()));
        columns
    }
}

impl Energy {
    /// Accounts of the ledger and what stands in them [J].
    pub fn accounts(&self) -> impl Iterator<Item = (&'static Column, f64)> {
        let value = |values: ColumnValues<'_>| match values {
            ColumnValues::F64([value]) => *value,
            ColumnValues::F64(_)
            | ColumnValues::U32(_)
            | ColumnValues::U64(_)
            | ColumnValues::Bool(_)
            | ColumnValues::Text(_) => 0.0,
        };
        Energy::MESSAGE.columns.iter().zip(self.values().map(value))
    }

    /// Applies `f` to every account and the same one of `other`.
    pub fn each_with(&mut self, other: &Energy, f: impl Fn(&'static Column, f64, f64) -> f64) {
        for (into, (account, value)) in self.values_mut().iter_mut().zip(other.accounts()) {
            into.each_f64(|own| *own = f(account, *own, value));
        }
    }

    /// Sum of all accounts of some kinds [J].
    fn sum_of(&self, is_meant: impl Fn(ColumnKind) -> bool) -> f64 {
        self.accounts().filter(|(account, _)| is_meant(account.kind)).map(|(_, value)| value).sum()
    }

    /// Kinetic and elastic [J].
    pub fn stored_j(&self) -> f64 {
        self.sum_of(ColumnKind::is_stored)
    }

    /// In springs, contacts and oil [J].
    pub fn elastic_j(&self) -> f64 {
        self.sum_of(|kind| kind == ColumnKind::Elastic)
    }

    /// Work of drives and reservoirs [J]: all accounts of its kind, written out because break expressions ask for it at every step.
    pub fn put_in_j(&self) -> f64 {
        let sum = self.work_in_j + self.work_oil_j;
        debug_assert!((sum - self.sum_of(|kind| kind == ColumnKind::WorkIn)).abs() <= 1e-12 * sum.abs());
        sum
    }

    /// All losses [J].
    pub fn lost_j(&self) -> f64 {
        self.sum_of(|kind| kind == ColumnKind::Lost)
    }
}

/// A snapshot of the State from which a run goes on to the bit.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Keyframe {
    /// Step to which it belongs.
    #[prost(uint64, tag = "1")]
    pub step: u64,
    /// XXH3-64 of the State, by which a reader checks it.
    #[prost(fixed64, tag = "2")]
    pub state_hash: u64,
    /// Every column of the State by name.
    #[prost(message, repeated, tag = "3")]
    pub columns: Vec<StateColumn>,
}

/// One named column of the State.
#[derive(Clone, PartialEq, prost::Message)]
pub struct StateColumn {
    /// Name of the column, as in docs/recording-format.md.
    #[prost(string, tag = "1")]
    pub name: String,
    /// ColumnValues of the column, bit for bit.
    #[prost(double, repeated, tag = "2")]
    pub values: Vec<f64>,
}

/// What of a link touches something (`Contacts::feature`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum Feature {
    /// Bush at the rear joint.
    RearBush = 0,
    /// Bush at the front joint.
    FrontBush = 1,
    /// Plate edge over the rear joint.
    RearPlateEnd = 2,
    /// Plate edge over the front joint.
    FrontPlateEnd = 3,
    /// Abutment at the rear joint.
    RearAbutment = 4,
    /// Abutment at the front joint.
    FrontAbutment = 5,
    /// Of a silent chain's link: flanks that face out of the link.
    RearOuterFlank = 6,
    /// Outer flank at the front, which leads.
    FrontOuterFlank = 7,
    /// Flanks that face each other across the crotch.
    RearInnerFlank = 8,
    /// Inner flank at the front.
    FrontInnerFlank = 9,
    /// A plate on an arc of a rail: its straight edge, or the rounds at its ends.
    PlateEdge = 10,
    /// The roller on the bush at the rear joint: a body of its own, which the force acts on.
    RearRoller = 11,
    /// The roller on the bush at the front joint.
    FrontRoller = 12,
}

impl Feature {
    /// Names in the order of the numbers.
    pub const NAMES: [&str; 13] = [
        "rear bush",
        "front bush",
        "rear plate end",
        "front plate end",
        "rear abutment",
        "front abutment",
        "trailing flank",
        "leading flank",
        "rear inner flank",
        "front inner flank",
        "plate edge",
        "rear roller",
        "front roller",
    ];

    /// What teeth touch at a joint of a link: its bush, or a roller on it.
    pub fn at_teeth(front: bool, is_roller: bool) -> Feature {
        match (front, is_roller) {
            (false, false) => Feature::RearBush,
            (true, false) => Feature::FrontBush,
            (false, true) => Feature::RearRoller,
            (true, true) => Feature::FrontRoller,
        }
    }

    /// Whether the force acts on a roller, not on the link whose number stands beside it.
    pub fn is_roller(feature: u32) -> bool {
        feature == Feature::RearRoller as u32 || feature == Feature::FrontRoller as u32
    }

    /// In words, of a `Contacts::feature`.
    pub fn name(feature: u32) -> &'static str {
        Self::NAMES.get(feature as usize).copied().unwrap_or("unknown part")
    }
}

/// Which part of a body is touched (`Contacts::segment`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u32)]
pub enum Segment {
    /// Seat at the bottom of a tooth gap.
    Seat = 0,
    /// Flank on the clockwise side of the gap.
    FlankClockwise = 1,
    /// Flank on the counterclockwise side of the gap.
    FlankCounterclockwise = 2,
    /// Rounding between flank and tip.
    TipCorner = 3,
    /// Top of a tooth.
    TipLand = 4,
    /// Straight face of a guide, or a line of a rail.
    GuideFace = 5,
    /// Rounding of a guide where the chain arrives.
    GuideLeadIn = 6,
    /// Rounding of a guide where the chain leaves.
    GuideLeadOut = 7,
    /// Ring of an abutment chain's sprocket.
    Ring = 8,
    /// A convex or concave arc of a rail, and the corner at its end.
    RailArc = 9,
    /// End of a rail.
    RailEnd = 10,
}

impl Segment {
    /// All segments, in the order of their numbers.
    pub const ALL: [Segment; 11] = [
        Segment::Seat,
        Segment::FlankClockwise,
        Segment::FlankCounterclockwise,
        Segment::TipCorner,
        Segment::TipLand,
        Segment::GuideFace,
        Segment::GuideLeadIn,
        Segment::GuideLeadOut,
        Segment::Ring,
        Segment::RailArc,
        Segment::RailEnd,
    ];

    /// Names in the order of the numbers.
    pub const NAMES: [&str; 11] = [
        "seat",
        "clockwise flank",
        "counterclockwise flank",
        "tip corner",
        "tip land",
        "guide face",
        "guide lead-in",
        "guide lead-out",
        "ring",
        "rail arc",
        "rail end",
    ];

    /// In words, of a `Contacts::segment`.
    pub fn name(segment: u32) -> &'static str {
        Self::NAMES.get(segment as usize).copied().unwrap_or("unknown part")
    }
}

/// A few scalars per frame, for plot panels.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Signals {
    /// Time of the frame [s].
    #[prost(double, tag = "1")]
    pub t_s: f64,
    /// Angle turned by the driver since step 0 [deg].
    #[prost(double, tag = "2")]
    pub crank_angle_deg: f64,
    /// Largest and smallest force in any joint [N].
    #[prost(double, tag = "3")]
    pub joint_force_max_n: f64,
    /// Smallest force in any joint [N].
    #[prost(double, tag = "4")]
    pub joint_force_min_n: f64,
    /// Largest normal force of any contact, per body of the header [N].
    #[prost(double, repeated, tag = "5")]
    pub contact_force_max_n: Vec<f64>,
    /// Per rotor [rpm].
    #[prost(double, repeated, tag = "6")]
    pub rotor_speed_rpm: Vec<f64>,
    /// Number of contacts.
    #[prost(uint32, tag = "7")]
    pub contacts: u32,
    /// Energy that does not add up [J].
    #[prost(double, tag = "8")]
    pub energy_error_j: f64,
    /// Per sensor of the header, in SI.
    #[prost(double, repeated, tag = "9")]
    pub sensors: Vec<f64>,
}

impl Signals {
    /// The scalars of a frame of a recording with `n_bodies` bodies.
    pub fn of(frame: &Frame, n_bodies: usize) -> Signals {
        let mut contact_force_max_n = vec![0.0_f64; n_bodies];
        for (body, force) in frame.contacts.body.iter().zip(&frame.contacts.normal_force_n) {
            if let Some(largest) = contact_force_max_n.get_mut(*body as usize) {
                *largest = largest.max(*force);
            }
        }
        // Squares: one root for the largest, one for the smallest.
        let squares = || frame.joints.force_x_n.iter().zip(&frame.joints.force_y_n).map(|(x, y)| x * x + y * y);
        Signals {
            t_s: frame.t_s,
            crank_angle_deg: frame.crank_angle_rad.to_degrees(),
            joint_force_max_n: squares().fold(0.0, f64::max).sqrt(),
            joint_force_min_n: squares().fold(f64::INFINITY, f64::min).sqrt(),
            contact_force_max_n,
            rotor_speed_rpm: frame.rotors.speed_rad_s.iter().map(|w| w / crate::units::RPM).collect(),
            contacts: frame.contacts.link.len() as u32,
            energy_error_j: frame.energy.error_j,
            sensors: frame.sensors.clone(),
        }
    }
}
