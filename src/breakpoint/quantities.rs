//! Quantities of break expressions: one row per quantity, with its dimension and meaning.

use crate::recording::columns::Rows;

/// Dimension of a quantity, with its units.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dimension {
    Length,
    Speed,
    Force,
    Time,
    Angle,
    AngularSpeed,
    Torque,
    Energy,
    Impulse,
    Pressure,
    Volume,
    /// Volume of oil per time.
    Flow,
    Power,
    /// Counts, indices and shares.
    Number,
    /// Name of a body, a feature or a segment.
    Name,
}

/// Unit, dimension, factor to SI. Longer names come before those that they begin with.
pub const UNITS: [(&str, Dimension, f64); 40] = [
    ("kW", Dimension::Power, 1e3),
    ("W", Dimension::Power, 1.0),
    ("mm3/s", Dimension::Flow, 1e-9),
    ("cm3/s", Dimension::Flow, 1e-6),
    ("l/min", Dimension::Flow, 1e-3 / 60.0),
    ("m3/s", Dimension::Flow, 1.0),
    ("mm3", Dimension::Volume, 1e-9),
    ("cm3", Dimension::Volume, 1e-6),
    ("m3", Dimension::Volume, 1.0),
    ("bar", Dimension::Pressure, 1e5),
    ("MPa", Dimension::Pressure, 1e6),
    ("Pa", Dimension::Pressure, 1.0),
    ("mm/s", Dimension::Speed, 1e-3),
    ("m/s", Dimension::Speed, 1.0),
    ("rad/s", Dimension::AngularSpeed, 1.0),
    ("deg/s", Dimension::AngularSpeed, std::f64::consts::PI / 180.0),
    ("rpm", Dimension::AngularSpeed, std::f64::consts::PI / 30.0),
    ("mN s", Dimension::Impulse, 1e-3),
    ("mNs", Dimension::Impulse, 1e-3),
    ("N s", Dimension::Impulse, 1.0),
    ("Ns", Dimension::Impulse, 1.0),
    ("N m", Dimension::Torque, 1.0),
    ("Nm", Dimension::Torque, 1.0),
    ("kN", Dimension::Force, 1e3),
    ("N", Dimension::Force, 1.0),
    ("rad", Dimension::Angle, 1.0),
    ("deg", Dimension::Angle, std::f64::consts::PI / 180.0),
    ("nm", Dimension::Length, 1e-9),
    ("um", Dimension::Length, 1e-6),
    ("\u{b5}m", Dimension::Length, 1e-6),
    ("\u{3bc}m", Dimension::Length, 1e-6),
    ("mm", Dimension::Length, 1e-3),
    ("mJ", Dimension::Energy, 1e-3),
    ("J", Dimension::Energy, 1.0),
    ("ms", Dimension::Time, 1e-3),
    ("us", Dimension::Time, 1e-6),
    ("\u{b5}s", Dimension::Time, 1e-6),
    ("m", Dimension::Length, 1.0),
    ("s", Dimension::Time, 1.0),
    ("%", Dimension::Number, 1e-2),
];

impl Dimension {
    /// In words, with an article.
    pub fn name(self) -> &'static str {
        match self {
            Dimension::Length => "a length",
            Dimension::Speed => "a speed",
            Dimension::Force => "a force",
            Dimension::Time => "a time",
            Dimension::Angle => "an angle",
            Dimension::AngularSpeed => "an angular speed",
            Dimension::Torque => "a torque",
            Dimension::Energy => "an energy",
            Dimension::Impulse => "an impulse",
            Dimension::Pressure => "a pressure",
            Dimension::Volume => "a volume",
            Dimension::Flow => "a flow",
            Dimension::Power => "a power",
            Dimension::Number => "a number without unit",
            Dimension::Name => "a name in quotes",
        }
    }

    /// Its SI unit; empty where it has none.
    pub fn si(self) -> &'static str {
        UNITS.iter().find(|(_, dimension, size)| *dimension == self && *size == 1.0).map_or("", |(name, ..)| *name)
    }

    /// Its units as a list.
    pub fn units(self) -> String {
        let own = UNITS.iter().filter(|(name, dimension, _)| *dimension == self && name.is_ascii());
        own.map(|(name, ..)| *name).collect::<Vec<_>>().join(", ")
    }
}

/// Object that a quantity belongs to. A quantity of a contact, an impact, a link or a joint without an index refers to
/// any of them; within one expression always to the same one. With `contact` or `impact`, `link` is the link in
/// contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    Contact,
    Impact,
    Link,
    Joint,
    Sprocket,
    Shaft,
    Arm,
    Slider,
    /// The ball of a check valve.
    Ball,
    /// Two parts that touch each other and no chain.
    Touch,
    Chamber,
    Reservoir,
    Passage,
    /// A span of a chain without links.
    Span,
    Energy,
    Run,
}

impl Scope {
    /// All of them.
    pub const ALL: [Scope; 15] = [
        Scope::Contact,
        Scope::Impact,
        Scope::Link,
        Scope::Joint,
        Scope::Sprocket,
        Scope::Shaft,
        Scope::Arm,
        Scope::Slider,
        Scope::Ball,
        Scope::Touch,
        Scope::Chamber,
        Scope::Reservoir,
        Scope::Passage,
        Scope::Span,
        Scope::Energy,
    ];

    /// The table of frames in which such an object has a row, and how its path in that table begins; None: the drive file does not name it.
    pub fn named_rows(self) -> Option<(Rows, &'static str)> {
        match self {
            Scope::Contact | Scope::Impact | Scope::Link | Scope::Joint | Scope::Energy | Scope::Run => None,
            Scope::Sprocket => Some((Rows::Rotor, "sprockets.")),
            Scope::Shaft => Some((Rows::Rotor, "shafts.")),
            Scope::Arm => Some((Rows::Rotor, "arms.")),
            Scope::Slider => Some((Rows::Slider, "sliders.")),
            Scope::Ball => Some((Rows::Slider, "passages.check.")),
            Scope::Touch => Some((Rows::Touch, "")),
            Scope::Chamber => Some((Rows::Chamber, "chambers.")),
            Scope::Reservoir => Some((Rows::Chamber, "reservoirs.")),
            Scope::Passage => Some((Rows::Passage, "passages.")),
            Scope::Span => Some((Rows::Span, "chains.")),
        }
    }

    /// How an expression names an object with this path; None: it is none of these.
    pub fn short_name(self, path: &str) -> Option<String> {
        let (rows, beginning) = self.named_rows()?;
        let own = path.strip_prefix(beginning)?;
        let words: Vec<&str> = own.split('.').collect();
        // A touch is a part, and what of it touches.
        let kept = if rows == Rows::Touch { 2 } else { 1 };
        Some(words.get(words.len().saturating_sub(kept)..)?.join("."))
    }

    pub fn name(self) -> &'static str {
        match self {
            Scope::Contact => "contact",
            Scope::Impact => "impact",
            Scope::Link => "link",
            Scope::Joint => "joint",
            Scope::Sprocket => "sprocket",
            Scope::Shaft => "shaft",
            Scope::Arm => "arm",
            Scope::Slider => "slider",
            Scope::Ball => "ball",
            Scope::Touch => "touch",
            Scope::Chamber => "chamber",
            Scope::Reservoir => "reservoir",
            Scope::Passage => "passage",
            Scope::Span => "span",
            Scope::Energy => "energy",
            Scope::Run => "",
        }
    }
}

/// Kind of value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    Penetration,
    NormalForce,
    TangentialForce,
    ApproachSpeed,
    NormalSpeed,
    TangentialSpeed,
    Age,
    Stick,
    Link,
    Tooth,
    Body,
    Feature,
    Segment,
    PeakForce,
    RiseTime,
    Impulse,
    Tension,
    Speed,
    VelocityX,
    VelocityY,
    Omega,
    X,
    Y,
    Angle,
    Force,
    Torque,
    OuterTorque,
    Position,
    SpringForce,
    OilForce,
    TouchForce,
    Gap,
    Pressure,
    Volume,
    Inflow,
    Flow,
    PressureDrop,
    Elongation,
    Power,
    Error,
    ErrorJ,
    Kinetic,
    Elastic,
    WorkIn,
    WorkOut,
    Lost,
    Time,
    Step,
    CrankAngle,
}

/// A row of the catalogue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantity {
    pub scope: Scope,
    pub name: &'static str,
    pub what: What,
    pub dimension: Dimension,
    pub meaning: &'static str,
}

const fn row(scope: Scope, name: &'static str, what: What, dimension: Dimension, meaning: &'static str) -> Quantity {
    Quantity { scope, name, what, dimension, meaning }
}

/// All quantities.
pub const QUANTITIES: [Quantity; 80] = [
    row(
        Scope::Contact,
        "penetration",
        What::Penetration,
        Dimension::Length,
        "depth of overlap along the normal; negative where it pushes within the step only",
    ),
    row(
        Scope::Contact,
        "normal_force",
        What::NormalForce,
        Dimension::Force,
        "force on the link along the normal, mean over the step",
    ),
    row(
        Scope::Contact,
        "tangential_force",
        What::TangentialForce,
        Dimension::Force,
        "friction force on the link, mean over the step",
    ),
    row(Scope::Contact, "approach_speed", What::ApproachSpeed, Dimension::Speed, "closing speed at first touch"),
    row(Scope::Contact, "normal_speed", What::NormalSpeed, Dimension::Speed, "rate of penetration"),
    row(
        Scope::Contact,
        "tangential_speed",
        What::TangentialSpeed,
        Dimension::Speed,
        "sliding speed of the link that friction works with",
    ),
    row(Scope::Contact, "age", What::Age, Dimension::Time, "time since first touch"),
    row(Scope::Contact, "stick", What::Stick, Dimension::Number, "1 while friction is below its limit, else 0"),
    row(Scope::Contact, "link", What::Link, Dimension::Number, "index of the link"),
    row(Scope::Contact, "tooth", What::Tooth, Dimension::Number, "tooth gap of a sprocket, from its mark"),
    row(Scope::Contact, "body", What::Body, Dimension::Name, "sprocket or guide that is touched"),
    row(Scope::Contact, "feature", What::Feature, Dimension::Name, "what of the link touches"),
    row(Scope::Contact, "segment", What::Segment, Dimension::Name, "which part of the body is touched"),
    row(Scope::Impact, "approach_speed", What::ApproachSpeed, Dimension::Speed, "closing speed at first touch"),
    row(Scope::Impact, "peak_force", What::PeakForce, Dimension::Force, "largest force within two tooth periods"),
    row(
        Scope::Impact,
        "rise_time",
        What::RiseTime,
        Dimension::Time,
        "from a tenth to nine tenths of the peak; none where the contact law's force jumps at the touch",
    ),
    row(Scope::Impact, "impulse", What::Impulse, Dimension::Impulse, "until the force has fallen to half its peak"),
    row(Scope::Impact, "link", What::Link, Dimension::Number, "index of the link"),
    row(Scope::Impact, "tooth", What::Tooth, Dimension::Number, "tooth gap of a sprocket, from its mark"),
    row(Scope::Impact, "body", What::Body, Dimension::Name, "sprocket or guide that is touched"),
    row(Scope::Impact, "feature", What::Feature, Dimension::Name, "what of the link touches"),
    row(Scope::Impact, "segment", What::Segment, Dimension::Name, "which part of the body is touched"),
    row(Scope::Link, "tension", What::Tension, Dimension::Force, "pull along the link, mean of both joints"),
    row(Scope::Link, "speed", What::Speed, Dimension::Speed, "of the centre of mass"),
    row(Scope::Link, "omega", What::Omega, Dimension::AngularSpeed, "angular velocity"),
    row(Scope::Link, "x", What::X, Dimension::Length, "centre of mass"),
    row(Scope::Link, "y", What::Y, Dimension::Length, "centre of mass"),
    row(Scope::Link, "angle", What::Angle, Dimension::Angle, "heading, rear joint to front joint"),
    row(Scope::Joint, "force", What::Force, Dimension::Force, "magnitude of the force in the joint"),
    row(Scope::Joint, "friction_torque", What::Torque, Dimension::Torque, "on the link in front"),
    row(Scope::Sprocket, "speed", What::Speed, Dimension::AngularSpeed, "angular velocity"),
    row(Scope::Sprocket, "angle", What::Angle, Dimension::Angle, "turned since step 0, plus that at assembly"),
    row(Scope::Sprocket, "chain_torque", What::Torque, Dimension::Torque, "of the chain on the sprocket"),
    row(Scope::Sprocket, "outer_torque", What::OuterTorque, Dimension::Torque, "of drive or load on the sprocket"),
    row(Scope::Arm, "speed", What::Speed, Dimension::AngularSpeed, "angular velocity"),
    row(Scope::Arm, "angle", What::Angle, Dimension::Angle, "from where it is drawn"),
    row(Scope::Arm, "chain_torque", What::Torque, Dimension::Torque, "of the chain on the arm"),
    row(
        Scope::Arm,
        "outer_torque",
        What::OuterTorque,
        Dimension::Torque,
        "of its spring, damper, loads and touching parts",
    ),
    row(Scope::Shaft, "speed", What::Speed, Dimension::AngularSpeed, "angular velocity"),
    row(Scope::Shaft, "angle", What::Angle, Dimension::Angle, "turned since step 0, plus that at assembly"),
    row(Scope::Shaft, "chain_torque", What::Torque, Dimension::Torque, "of the chains on it"),
    row(Scope::Shaft, "outer_torque", What::OuterTorque, Dimension::Torque, "of loads and couplings on it"),
    row(Scope::Slider, "position", What::Position, Dimension::Length, "from where it is drawn, outwards positive"),
    row(Scope::Slider, "speed", What::Speed, Dimension::Speed, "along its way"),
    row(Scope::Slider, "spring_force", What::SpringForce, Dimension::Force, "of its spring, damper and loads on it"),
    row(Scope::Slider, "oil_force", What::OilForce, Dimension::Force, "of the oil on it"),
    row(Scope::Slider, "touch_force", What::TouchForce, Dimension::Force, "of all that it touches, along its way"),
    row(Scope::Ball, "position", What::Position, Dimension::Length, "its lift from its seat"),
    row(Scope::Ball, "speed", What::Speed, Dimension::Speed, "along its way"),
    row(Scope::Ball, "spring_force", What::SpringForce, Dimension::Force, "of its spring on it"),
    row(Scope::Ball, "oil_force", What::OilForce, Dimension::Force, "of the oil on it"),
    row(Scope::Ball, "touch_force", What::TouchForce, Dimension::Force, "of seat and stop on it"),
    row(Scope::Touch, "gap", What::Gap, Dimension::Length, "distance of the two parts, negative where they overlap"),
    row(Scope::Touch, "normal_force", What::NormalForce, Dimension::Force, "that parts them, mean over the step"),
    row(Scope::Touch, "tangential_force", What::TangentialForce, Dimension::Force, "friction, mean over the step"),
    row(Scope::Touch, "approach_speed", What::ApproachSpeed, Dimension::Speed, "closing speed at first touch"),
    row(Scope::Touch, "age", What::Age, Dimension::Time, "time since first touch"),
    row(Scope::Chamber, "pressure", What::Pressure, Dimension::Pressure, "gauge pressure"),
    row(Scope::Chamber, "volume", What::Volume, Dimension::Volume, "with its pistons where they stand"),
    row(Scope::Chamber, "inflow", What::Inflow, Dimension::Flow, "sum of the flows into it"),
    row(Scope::Reservoir, "pressure", What::Pressure, Dimension::Pressure, "gauge pressure, which is constant"),
    row(Scope::Reservoir, "inflow", What::Inflow, Dimension::Flow, "sum of the flows into it"),
    row(Scope::Passage, "flow", What::Flow, Dimension::Flow, "from its first end to its second"),
    row(Scope::Passage, "pressure_drop", What::PressureDrop, Dimension::Pressure, "from its first end to its second"),
    row(Scope::Span, "tension", What::Tension, Dimension::Force, "of a span of a chain without links"),
    row(Scope::Span, "elongation", What::Elongation, Dimension::Length, "from where it has the preload"),
    row(Scope::Span, "power", What::Power, Dimension::Power, "that it takes to its second sprocket"),
    row(Scope::Energy, "error", What::Error, Dimension::Number, "what does not add up, as a share of the work put in"),
    row(Scope::Energy, "error_j", What::ErrorJ, Dimension::Energy, "what does not add up"),
    row(Scope::Energy, "kinetic", What::Kinetic, Dimension::Energy, "of links and free sprockets"),
    row(Scope::Energy, "elastic", What::Elastic, Dimension::Energy, "in joints, contacts and springs"),
    row(Scope::Energy, "work_in", What::WorkIn, Dimension::Energy, "of the drives, and of reservoirs of oil"),
    row(Scope::Energy, "work_out", What::WorkOut, Dimension::Energy, "on the loads"),
    row(Scope::Energy, "lost", What::Lost, Dimension::Energy, "all losses"),
    row(Scope::Run, "time", What::Time, Dimension::Time, "since the start of the recording"),
    row(Scope::Run, "step", What::Step, Dimension::Number, "steps since the start of the recording"),
    row(Scope::Run, "crank_angle", What::CrankAngle, Dimension::Angle, "turned by the driver"),
    row(Scope::Link, "vx", What::VelocityX, Dimension::Speed, "velocity of the centre of mass, x"),
    row(Scope::Link, "vy", What::VelocityY, Dimension::Speed, "velocity of the centre of mass, y"),
    row(Scope::Link, "index", What::Link, Dimension::Number, "index of the link"),
];
