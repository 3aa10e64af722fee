//! What a recording holds: one [`Header`] and many [`Frame`]s.
//!
//! Both are protobuf messages (`assets/pitchline.proto` is their stable schema; a test holds the two together). All values
//! are SI and f64; columns run in chain order, so that `links.x_m[i]` belongs to link `i`. A Frame is complete: nobody who
//! reads it has to ask the model.

/// Version of the recording's layout. A reader refuses others and says so: in version 1 forces were those of the instant, and
/// accelerations were missing.
pub const FORMAT_VERSION: u32 = 3;

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
    /// Sprockets first (in the order of `Rotors`), then guides, then rails.
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

/// One link: its row and rigid-body data.
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub struct LinkInfo {
    /// Index into [`Header::link_outlines`].
    #[prost(uint32, tag = "1")]
    pub outline: u32,
    /// Pin-to-pin distance, unloaded [m].
    #[prost(double, tag = "2")]
    pub pitch_m: f64,
    /// Mass [kg].
    #[prost(double, tag = "3")]
    pub mass_kg: f64,
    /// Moment of inertia about the centre of mass [kg m2].
    #[prost(double, tag = "4")]
    pub inertia_kg_m2: f64,
    /// Index of the link ahead, which its front joint joins it to: chains are closed, each in itself.
    #[prost(uint32, tag = "5")]
    pub ahead: u32,
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

/// A sprocket or a guide.
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
    /// Rotation of a guide's frame [rad]; of what turns, at angle zero.
    #[prost(double, tag = "5")]
    pub angle_rad: f64,
    /// Number of teeth; 0 for a guide or a rail.
    #[prost(uint32, tag = "6")]
    pub teeth: u32,
    /// Its whole contour.
    #[prost(message, optional, tag = "7")]
    pub outline: Option<Outline>,
    /// Row in `Rotors` of what it turns by; absent where it stands still.
    #[prost(uint32, optional, tag = "8")]
    pub coordinate: Option<u32>,
}

impl BodyInfo {
    /// How far it has turned in a frame [rad].
    pub fn turned_rad(&self, frame: &Frame) -> f64 {
        self.coordinate.and_then(|q| frame.rotors.angle_rad.get(q as usize)).copied().unwrap_or(0.0)
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

/// Everything at one node of the simulation. Poses, speeds and penetrations are those there; forces, torques and accelerations are means over
/// the step about it.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Frame {
    /// Step number; `t_s` = step x `Header::step_s`.
    #[prost(uint64, tag = "1")]
    pub step: u64,
    /// Simulated time since the start of the recording [s].
    #[prost(double, tag = "2")]
    pub t_s: f64,
    /// XXH3-64 of the whole State.
    #[prost(fixed64, tag = "3")]
    pub state_hash: u64,
    /// Angle turned by the driver since step 0 [rad].
    #[prost(double, tag = "4")]
    pub crank_angle_rad: f64,
    /// Pose and motion of every link.
    #[prost(message, required, tag = "5")]
    pub links: Links,
    /// Force and torque in every joint.
    #[prost(message, required, tag = "6")]
    pub joints: Joints,
    /// Everything that touches.
    #[prost(message, required, tag = "7")]
    pub contacts: Contacts,
    /// What turns: sprockets or shafts, then arms.
    #[prost(message, required, tag = "8")]
    pub rotors: Rotors,
    /// The energy ledger.
    #[prost(message, required, tag = "9")]
    pub energy: Energy,
    /// What every sensor stands at, in SI, before its gain and its errors.
    #[prost(double, repeated, tag = "10")]
    pub sensors: Vec<f64>,
}

/// Pose and velocity of every link at its centre of mass.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Links {
    /// x of the centre of mass [m].
    #[prost(double, repeated, tag = "1")]
    pub x_m: Vec<f64>,
    /// y of the centre of mass [m].
    #[prost(double, repeated, tag = "2")]
    pub y_m: Vec<f64>,
    /// Heading of the link, rear pin to front pin [rad], in [-pi, pi].
    #[prost(double, repeated, tag = "3")]
    pub angle_rad: Vec<f64>,
    /// x of the velocity of the centre of mass [m/s].
    #[prost(double, repeated, tag = "4")]
    pub vx_m_s: Vec<f64>,
    /// y of the velocity of the centre of mass [m/s].
    #[prost(double, repeated, tag = "5")]
    pub vy_m_s: Vec<f64>,
    /// Angular velocity, counterclockwise positive [rad/s].
    #[prost(double, repeated, tag = "6")]
    pub omega_rad_s: Vec<f64>,
    /// Acceleration of the centre of mass, mean over the step [m/s2].
    #[prost(double, repeated, tag = "7")]
    pub ax_m_s2: Vec<f64>,
    /// y of the acceleration of the centre of mass, mean over the step [m/s2].
    #[prost(double, repeated, tag = "8")]
    pub ay_m_s2: Vec<f64>,
    /// Angular acceleration, mean over the step [rad/s2].
    #[prost(double, repeated, tag = "9")]
    pub alpha_rad_s2: Vec<f64>,
}

/// Joint `j` joins the front end of link `j` to the rear end of link `j + 1`; the last closes the loop.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Joints {
    /// Force on link `j + 1` at joint `j` [N]; link `j` feels the opposite.
    #[prost(double, repeated, tag = "1")]
    pub force_x_n: Vec<f64>,
    /// y of the force on link `j + 1` at joint `j` [N].
    #[prost(double, repeated, tag = "2")]
    pub force_y_n: Vec<f64>,
    /// Friction torque on link `j + 1` [N m].
    #[prost(double, repeated, tag = "3")]
    pub friction_torque_nm: Vec<f64>,
}

/// All contacts that overlap at the instant or push within the step, sorted by link, feature, body.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Contacts {
    /// Index of the link.
    #[prost(uint32, repeated, tag = "1")]
    pub link: Vec<u32>,
    /// What of the link touches: see [`Feature`].
    #[prost(uint32, repeated, tag = "2")]
    pub feature: Vec<u32>,
    /// Index into `Header::bodies`.
    #[prost(uint32, repeated, tag = "3")]
    pub body: Vec<u32>,
    /// Tooth gap of a sprocket, counted counterclockwise from its mark; 0 on a guide.
    #[prost(uint32, repeated, tag = "4")]
    pub tooth: Vec<u32>,
    /// Element of the body: see [`Segment`].
    #[prost(uint32, repeated, tag = "5")]
    pub segment: Vec<u32>,
    /// Foot of the contact on the body's contour [m].
    #[prost(double, repeated, tag = "6")]
    pub point_body_x_m: Vec<f64>,
    /// y of the foot on the body's contour [m].
    #[prost(double, repeated, tag = "7")]
    pub point_body_y_m: Vec<f64>,
    /// Deepest point of the link's contour [m].
    #[prost(double, repeated, tag = "8")]
    pub point_link_x_m: Vec<f64>,
    /// y of the deepest point of the link's contour [m].
    #[prost(double, repeated, tag = "9")]
    pub point_link_y_m: Vec<f64>,
    /// Unit normal out of the body, towards the link.
    #[prost(double, repeated, tag = "10")]
    pub normal_x: Vec<f64>,
    /// y of the unit normal.
    #[prost(double, repeated, tag = "11")]
    pub normal_y: Vec<f64>,
    /// Depth of overlap along the normal at the instant; negative where the contact pushes within the step only [m].
    #[prost(double, repeated, tag = "12")]
    pub penetration_m: Vec<f64>,
    /// Closing speed along the normal when the contact was first touched [m/s].
    #[prost(double, repeated, tag = "13")]
    pub approach_speed_m_s: Vec<f64>,
    /// Rate of penetration [m/s].
    #[prost(double, repeated, tag = "14")]
    pub normal_speed_m_s: Vec<f64>,
    /// Sliding speed of the link over the body along the tangent (normal turned by +90 degrees) that friction works with [m/s].
    #[prost(double, repeated, tag = "15")]
    pub tangential_speed_m_s: Vec<f64>,
    /// Force on the link along the normal [N], never negative; mean over the step.
    #[prost(double, repeated, tag = "16")]
    pub normal_force_n: Vec<f64>,
    /// Friction force on the link along the tangent [N]; mean over the step.
    #[prost(double, repeated, tag = "17")]
    pub tangential_force_n: Vec<f64>,
    /// True while the friction is below its limit.
    #[prost(bool, repeated, tag = "18")]
    pub stick: Vec<bool>,
    /// Time since first touch [s].
    #[prost(double, repeated, tag = "19")]
    pub age_s: Vec<f64>,
    /// What the contact law gives at the instant [N], never negative.
    #[prost(double, repeated, tag = "20")]
    pub instant_force_n: Vec<f64>,
}

/// One row per sprocket, in the order of `Header::bodies`.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Rotors {
    /// Angle turned since step 0 plus the angle at assembly [rad].
    #[prost(double, repeated, tag = "1")]
    pub angle_rad: Vec<f64>,
    /// Angular velocity, counterclockwise positive [rad/s].
    #[prost(double, repeated, tag = "2")]
    pub speed_rad_s: Vec<f64>,
    /// Torque of the chain on the sprocket [N m].
    #[prost(double, repeated, tag = "3")]
    pub chain_torque_nm: Vec<f64>,
    /// Torque of the drive or load on the sprocket [N m].
    #[prost(double, repeated, tag = "4")]
    pub outer_torque_nm: Vec<f64>,
}

/// The ledger: what went in, what went out, what is stored, what was lost, since the first frame; and what does not add up.
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub struct Energy {
    /// Kinetic energy of links, free sprockets, arms and sliders [J].
    #[prost(double, tag = "1")]
    pub kinetic_j: f64,
    /// Stored in the pin joints.
    #[prost(double, tag = "2")]
    pub elastic_joint_j: f64,
    /// Stored in contacts with sprockets and guides, and of parts that touch each other.
    #[prost(double, tag = "3")]
    pub elastic_contact_j: f64,
    /// Work of the drives, and of reservoirs of oil.
    #[prost(double, tag = "4")]
    pub work_in_j: f64,
    /// Work done on the loads.
    #[prost(double, tag = "5")]
    pub work_out_j: f64,
    /// Lost to damping in the joints [J].
    #[prost(double, tag = "6")]
    pub lost_pin_damping_j: f64,
    /// Lost to friction in the joints [J].
    #[prost(double, tag = "7")]
    pub lost_pin_friction_j: f64,
    /// Lost to damping of contacts with sprockets [J].
    #[prost(double, tag = "8")]
    pub lost_contact_damping_j: f64,
    /// Lost to friction on sprockets [J].
    #[prost(double, tag = "9")]
    pub lost_contact_friction_j: f64,
    /// Lost to damping of contacts with guides and rails [J].
    #[prost(double, tag = "10")]
    pub lost_guide_damping_j: f64,
    /// Lost to friction on guides and rails [J].
    #[prost(double, tag = "11")]
    pub lost_guide_friction_j: f64,
    /// work in - work out - lost - change of stored energy.
    #[prost(double, tag = "12")]
    pub error_j: f64,
    /// Stored in the springs of arms and sliders and in oil; lost in their dampers and in passages of oil.
    #[prost(double, tag = "13")]
    pub elastic_spring_j: f64,
    /// Lost in dampers of arms and sliders and in passages of oil [J].
    #[prost(double, tag = "14")]
    pub lost_spring_damping_j: f64,
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
    /// Values of the column, bit for bit.
    #[prost(double, repeated, tag = "2")]
    pub values: Vec<f64>,
}

/// Something that happened between frames.
#[derive(Clone, PartialEq, prost::Message)]
pub struct Event {
    /// Step at which it happened.
    #[prost(uint64, tag = "1")]
    pub step: u64,
    /// Time of that step [s].
    #[prost(double, tag = "2")]
    pub t_s: f64,
    /// `first_touch`, ...
    #[prost(string, tag = "3")]
    pub kind: String,
    /// One sentence, with numbers and units.
    #[prost(string, tag = "4")]
    pub text: String,
    /// Index of the link; 0 where there is none.
    #[prost(uint32, tag = "5")]
    pub link: u32,
    /// Index into `Header::bodies`; 0 where there is none.
    #[prost(uint32, tag = "6")]
    pub body: u32,
    /// Quantity the event is about, e.g. the approach speed [m/s].
    #[prost(double, tag = "7")]
    pub value: f64,
}

/// A part of a link meets a body after it was free of it for two tooth periods; see [`crate::impacts`] for the definitions.
#[derive(Clone, Copy, PartialEq, prost::Message)]
pub struct Impact {
    /// Index of the link.
    #[prost(uint32, tag = "1")]
    pub link: u32,
    /// What of the link touches: see [`Feature`].
    #[prost(uint32, tag = "2")]
    pub feature: u32,
    /// Index into [`Header::bodies`].
    #[prost(uint32, tag = "3")]
    pub body: u32,
    /// Tooth gap of a sprocket, as in [`Contacts`].
    #[prost(uint32, tag = "4")]
    pub tooth: u32,
    /// Element of the body: see [`Segment`].
    #[prost(uint32, tag = "5")]
    pub segment: u32,
    /// Step of the first touch, and its time [s].
    #[prost(uint64, tag = "6")]
    pub step: u64,
    /// Time of the first touch [s].
    #[prost(double, tag = "7")]
    pub t_s: f64,
    /// Closing speed along the normal there [m/s].
    #[prost(double, tag = "8")]
    pub approach_speed_m_s: f64,
    /// Largest normal force within the first two tooth periods [N], and its time after the first touch [s].
    #[prost(double, tag = "9")]
    pub peak_force_n: f64,
    /// Time of the peak after the first touch [s].
    #[prost(double, tag = "10")]
    pub peak_after_s: f64,
    /// Integral of the normal force from the first touch until, after its peak, it has fallen to half of it [N s].
    #[prost(double, tag = "11")]
    pub impulse_n_s: f64,
    /// From a tenth to nine tenths of the peak [s].
    #[prost(double, tag = "12")]
    pub rise_time_s: f64,
    /// Mean normal force over the second tooth period [N].
    #[prost(double, tag = "13")]
    pub second_period_mean_n: f64,
    /// Place of the first touch on the body [m].
    #[prost(double, tag = "14")]
    pub x_m: f64,
    /// y of the place of the first touch [m].
    #[prost(double, tag = "15")]
    pub y_m: f64,
    /// How long it was watched [s]: less than two tooth periods where the recording ends.
    #[prost(double, tag = "16")]
    pub watched_s: f64,
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
}

impl Feature {
    /// Names in the order of the numbers.
    pub const NAMES: [&str; 11] = [
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
    ];

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
