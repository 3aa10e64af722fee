//! Breakpoints: expressions over the quantities of a frame and the impacts of a step, evaluated in every step.
//!
//! A hit is a contact, link or joint that fulfils the expression and did not do so in the step before; or an impact
//! that fulfils it; or, if the expression refers to none of these, the step in which it becomes true. Hits are the same
//! as in a scan over frames of all steps, because both read the columns of the step; those of frames are rounded to what
//! is stored. Only energies are summed in another order than in frames; where rounding could decide, a frame is taken.

mod columns;
mod extremes;
mod ledger;
#[doc(hidden)]
pub mod parse;
#[doc(hidden)]
pub mod quantities;
#[doc(hidden)]
pub mod scratch;

use crate::diag::Report;
use crate::drive::Drive;
use crate::recording::columns::Rows;
use crate::recording::frame::{Energy, Frame, Impact};
use quantities::{Quantity, Scope, What};

/// Names of the drive's bodies, and its numbers of links.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Names {
    /// Paths as in the header of a recording.
    pub bodies: Vec<String>,
    /// Paths of sprockets, shafts and arms, and their rows in `rotors`.
    pub turning: Vec<(String, usize)>,
    /// Paths of what else has a row in a table of frames.
    pub rows: Vec<(Rows, Vec<String>)>,
    /// Links of every chain.
    pub chains: Vec<usize>,
}

impl Names {
    /// Those of a drive.
    pub fn of(drive: &Drive) -> Names {
        Names {
            bodies: drive
                .sprockets
                .iter()
                .map(|s| format!("sprockets.{}", s.name))
                .chain(drive.guides.iter().map(|g| format!("guides.fixed.{}", g.name)))
                .chain(drive.rails.iter().map(|r| format!("guides.rail.{}", r.name)))
                .collect(),
            turning: drive.turning_paths(),
            rows: [Rows::Slider, Rows::Touch, Rows::Chamber, Rows::Passage, Rows::Span]
                .map(|rows| (rows, drive.row_paths(rows)))
                .to_vec(),
            chains: (0..drive.chains()).map(|c| drive.link_bodies_of(c)).collect(),
        }
    }

    /// What a scope can name: as an expression calls it, and its row.
    fn named(&self, scope: Scope) -> Vec<(String, usize)> {
        let Some((wanted, _)) = scope.named_rows() else { return Vec::new() };
        let all: Vec<(&String, usize)> = match wanted {
            Rows::Rotor => self.turning.iter().map(|(path, row)| (path, *row)).collect(),
            Rows::Link | Rows::Joint | Rows::Roller | Rows::Contact => Vec::new(),
            Rows::Slider | Rows::Touch | Rows::Chamber | Rows::Passage | Rows::Span => {
                let own = self.rows.iter().filter(|(rows, _)| *rows == wanted);
                own.flat_map(|(_, paths)| paths.iter().enumerate().map(|(row, path)| (path, row))).collect()
            }
        };
        all.into_iter().filter_map(|(path, row)| Some((scope.short_name(path)?, row))).collect()
    }

    /// Number of links of all chains together.
    pub fn links(&self) -> usize {
        self.chains.iter().sum()
    }
}

#[doc(hidden)]
#[derive(Clone, Debug, PartialEq)]
pub enum Expr {
    Any(Vec<Expr>),
    All(Vec<Expr>),
    Not(Box<Expr>),
    Compare(Compare),
}

#[doc(hidden)]
#[derive(Clone, Debug, PartialEq)]
pub enum Compare {
    Numbers {
        left: Number,
        operator: Operator,
        right: Number,
    },
    /// Whether the body, feature or segment is a member of a set, or is not.
    Name {
        quantity: &'static Quantity,
        set: Vec<u32>,
        member: bool,
    },
}

#[doc(hidden)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Number {
    /// In SI.
    Constant(f64),
    Quantity {
        quantity: &'static Quantity,
        /// Index of a link or joint, or row of what is named.
        index: Option<usize>,
        absolute: bool,
    },
}

#[doc(hidden)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operator {
    Above,
    AtLeast,
    Below,
    AtMost,
    Equal,
    Unequal,
}

#[doc(hidden)]
/// The rows to which `contact`, `impact`, `link` and `joint` without an index refer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BoundRows<'a> {
    /// Row of the contacts, or lane of a contact group.
    pub contact: Option<usize>,
    pub impact: Option<&'a Impact>,
    pub link: Option<usize>,
    pub joint: Option<usize>,
}

/// An object that fulfils an expression.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Subject {
    /// The whole drive: the expression names no link, joint, contact or impact.
    Drive,
    /// A part of a link on a body.
    Contact {
        /// Index of the link.
        link: u32,
        /// The part of the link that touches: see [`Feature`](crate::recording::frame::Feature).
        feature: u32,
        /// Index into `Header::bodies`.
        body: u32,
    },
    /// The link with this index, counted through all chains.
    Link(u32),
    /// The joint with this index: it joins the link of the same index to the next.
    Joint(u32),
}

/// An event at which the run stops.
#[derive(Clone, Debug, PartialEq)]
pub struct Hit {
    /// Step of the hit; of an impact, the step of its first touch.
    pub step: u64,
    /// Time of that step [s].
    pub t_s: f64,
    /// What fulfilled the expression.
    pub subject: Subject,
    /// For expressions about impacts.
    pub impact: Option<Impact>,
}

#[doc(hidden)]
/// Source of values. None: the value is not known here.
pub trait QuantityValues {
    fn number(&self, quantity: &Quantity, index: Option<usize>, bound: &BoundRows<'_>) -> Option<f64>;
    fn name(&self, what: What, bound: &BoundRows<'_>) -> Option<u32>;
    /// Uncertainty of a value.
    fn uncertainty(&self, _quantity: &Quantity) -> f64 {
        0.0
    }
}

/// A checked expression.
#[derive(Clone, Debug, PartialEq)]
pub struct Breakpoint {
    /// The expression as it was written.
    pub text: String,
    /// The expression, parsed.
    pub expr: Expr,
    /// Which columns of a step it needs.
    pub uses: Uses,
    /// Link counts of the chains that it refers to.
    chains: Vec<usize>,
}

#[doc(hidden)]
/// Properties of an expression.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Uses {
    pub contact: bool,
    pub impact: bool,
    /// Peak, rise time or impulse: known two tooth periods after first contact.
    pub impact_over: bool,
    /// Link or joint without an index.
    pub any_link: bool,
    pub any_joint: bool,
    /// Anything except impacts.
    pub frame: bool,
    pub energy: bool,
    pub segments: bool,
    /// Anything that changes while the contact partners stay the same.
    pub varying: bool,
}

impl Breakpoint {
    /// Reads and checks an expression.
    ///
    /// # Errors
    /// An unknown name or unit, or another mistake, with its place in the text.
    pub fn parse(text: &str, names: &Names) -> Result<Breakpoint, Report> {
        let expr = parse::parse(text, names)?;
        let mut uses = Uses::default();
        collect_uses(&expr, &mut uses);
        if uses.contact && uses.impact {
            return Err(parse::refused(
                text,
                "an expression asks about contacts or about impacts, not about both",
                "what an impact touches has names of its own: impact.body, impact.tooth, impact.feature",
            ));
        }
        Ok(Breakpoint { text: text.to_string(), expr, uses, chains: names.chains.clone() })
    }

    /// Everything in a frame that fulfils the expression, sorted. For expressions about impacts see
    /// [`Breakpoint::impact_holds`].
    pub fn holding(&self, frame: &Frame) -> Vec<Subject> {
        let mut found = Vec::new();
        let c = &frame.contacts;
        if self.uses.contact {
            for row in 0..c.link.len() {
                let bound = BoundRows { contact: Some(row), link: Some(c.link[row] as usize), ..BoundRows::default() };
                if self.holds_for(frame, bound) {
                    found.push(Subject::Contact { link: c.link[row], feature: c.feature[row], body: c.body[row] });
                }
            }
        } else if self.uses.any_link {
            let links = (0..frame.links.x_m.len())
                .filter(|i| self.holds_for(frame, BoundRows { link: Some(*i), ..BoundRows::default() }));
            found.extend(links.map(|i| Subject::Link(i as u32)));
        } else if self.uses.any_joint {
            let joints = (0..frame.joints.force_x_n.len()).filter(|j| {
                truth(&self.expr, &self.values_of(frame), &BoundRows { joint: Some(*j), ..BoundRows::default() })
                    == Some(true)
            });
            found.extend(joints.map(|j| Subject::Joint(j as u32)));
        } else if truth(&self.expr, &self.values_of(frame), &BoundRows::default()) == Some(true) {
            found.push(Subject::Drive);
        }
        found.sort_unstable();
        found.dedup();
        found
    }

    fn values_of<'a>(&'a self, frame: &'a Frame) -> FrameValues<'a> {
        FrameValues { frame, chains: &self.chains }
    }

    /// Whether it holds; for any joint, if the expression refers to any joint.
    fn holds_for(&self, frame: &Frame, bound: BoundRows<'_>) -> bool {
        if !self.uses.any_joint {
            return truth(&self.expr, &self.values_of(frame), &bound) == Some(true);
        }
        (0..frame.joints.force_x_n.len())
            .any(|j| truth(&self.expr, &self.values_of(frame), &BoundRows { joint: Some(j), ..bound }) == Some(true))
    }

    /// Whether an impact fulfils the expression, in the frame of a step.
    pub fn impact_holds(&self, impact: &Impact, frame: &Frame) -> bool {
        self.holds_for(
            frame,
            BoundRows { impact: Some(impact), link: Some(impact.link as usize), ..BoundRows::default() },
        )
    }
}

fn collect_uses(expr: &Expr, uses: &mut Uses) {
    let mut quantity = |q: &Quantity, index: Option<usize>| match q.scope {
        Scope::Contact => {
            (uses.contact, uses.frame) = (true, true);
            uses.varying |= !matches!(q.what, What::Link | What::Tooth | What::Body | What::Feature | What::Segment);
            uses.segments |= q.what == What::Segment;
        }
        Scope::Impact => {
            uses.impact = true;
            uses.impact_over |= matches!(q.what, What::PeakForce | What::RiseTime | What::Impulse);
        }
        Scope::Link => {
            uses.any_link |= index.is_none();
            (uses.frame, uses.varying) = (true, true);
        }
        Scope::Joint => {
            uses.any_joint |= index.is_none();
            (uses.frame, uses.varying) = (true, true);
        }
        Scope::Energy => (uses.energy, uses.frame, uses.varying) = (true, true, true),
        Scope::Sprocket | Scope::Shaft | Scope::Arm | Scope::Run => (uses.frame, uses.varying) = (true, true),
        Scope::Slider | Scope::Ball | Scope::Touch => (uses.frame, uses.varying) = (true, true),
        Scope::Chamber | Scope::Reservoir | Scope::Passage | Scope::Span => (uses.frame, uses.varying) = (true, true),
    };
    match expr {
        Expr::Any(parts) | Expr::All(parts) => parts.iter().for_each(|p| collect_uses(p, uses)),
        Expr::Not(inner) => collect_uses(inner, uses),
        Expr::Compare(Compare::Name { quantity: q, .. }) => quantity(q, None),
        Expr::Compare(Compare::Numbers { left, right, .. }) => {
            for number in [left, right] {
                if let Number::Quantity { quantity: q, index, .. } = number {
                    quantity(q, *index);
                }
            }
        }
    }
}

#[doc(hidden)]
/// Whether an expression is true; None if the values do not decide it.
pub fn truth(expr: &Expr, values: &impl QuantityValues, bound: &BoundRows<'_>) -> Option<bool> {
    match expr {
        Expr::Not(inner) => truth(inner, values, bound).map(|t| !t),
        Expr::All(parts) => {
            let mut all = Some(true);
            for part in parts {
                match truth(part, values, bound) {
                    Some(false) => return Some(false),
                    Some(true) => {}
                    None => all = None,
                }
            }
            all
        }
        Expr::Any(parts) => {
            let mut any = Some(false);
            for part in parts {
                match truth(part, values, bound) {
                    Some(true) => return Some(true),
                    Some(false) => {}
                    None => any = None,
                }
            }
            any
        }
        Expr::Compare(Compare::Name { quantity, set, member }) => {
            values.name(quantity.what, bound).map(|name| set.contains(&name) == *member)
        }
        Expr::Compare(Compare::Numbers { left, operator, right }) => {
            let (a, b) = (number(left, values, bound)?, number(right, values, bound)?);
            let uncertainty = |n: &Number| match n {
                Number::Constant(_) => 0.0,
                Number::Quantity { quantity, .. } => values.uncertainty(quantity),
            };
            let margin = uncertainty(left) + uncertainty(right);
            if margin > 0.0 && (a - b).abs() <= margin {
                return None;
            }
            Some(operator.holds(a, b))
        }
    }
}

fn number(number: &Number, values: &impl QuantityValues, bound: &BoundRows<'_>) -> Option<f64> {
    match number {
        Number::Constant(value) => Some(*value),
        Number::Quantity { quantity, index, absolute } => {
            let value = values.number(quantity, *index, bound)?;
            Some(if *absolute { value.abs() } else { value })
        }
    }
}

/// The value of a number in a frame; `chains`: links of every chain.
pub fn in_frame(wanted: &Number, frame: &Frame, chains: &[usize]) -> Option<f64> {
    number(wanted, &FrameValues { frame, chains }, &BoundRows::default())
}

impl Operator {
    /// The operator for exchanged sides.
    fn mirrored(self) -> Operator {
        match self {
            Operator::Above => Operator::Below,
            Operator::AtLeast => Operator::AtMost,
            Operator::Below => Operator::Above,
            Operator::AtMost => Operator::AtLeast,
            Operator::Equal | Operator::Unequal => self,
        }
    }

    pub fn holds(self, a: f64, b: f64) -> bool {
        match self {
            Operator::Above => a > b,
            Operator::AtLeast => a >= b,
            Operator::Below => a < b,
            Operator::AtMost => a <= b,
            Operator::Equal => a == b,
            Operator::Unequal => a != b,
        }
    }
}

/// Values of impacts, which are the same for every source of values.
fn impact_number(what: What, impact: &Impact) -> f64 {
    match what {
        What::ApproachSpeed => impact.approach_speed_m_s,
        What::PeakForce => impact.peak_force_n,
        // No number compares as true where it is not told.
        What::RiseTime => impact.own_rise_time_s().unwrap_or(f64::NAN),
        What::Impulse => impact.impulse_n_s,
        What::Link => f64::from(impact.link),
        What::Tooth => f64::from(impact.tooth),
        _ => f64::NAN,
    }
}

fn impact_name(what: What, impact: &Impact) -> Option<u32> {
    match what {
        What::Body => Some(impact.body),
        What::Feature => Some(impact.feature),
        What::Segment => Some(impact.segment),
        _ => None,
    }
}

/// A frame, with the number of links of every chain.
struct FrameValues<'a> {
    frame: &'a Frame,
    chains: &'a [usize],
}

impl QuantityValues for FrameValues<'_> {
    fn number(&self, quantity: &Quantity, index: Option<usize>, bound: &BoundRows<'_>) -> Option<f64> {
        match quantity.scope {
            Scope::Contact => contact_number(self.frame, quantity.what, bound.contact?),
            Scope::Impact => bound.impact.map(|impact| impact_number(quantity.what, impact)),
            Scope::Link => self.link_number(quantity.what, index.or(bound.link)?),
            Scope::Joint => {
                let (j, joints) = (index.or(bound.joint)?, &self.frame.joints);
                match quantity.what {
                    What::Force => Some(libm::hypot(*joints.force_x_n.get(j)?, *joints.force_y_n.get(j)?)),
                    _ => joints.friction_torque_nm.get(j).copied(),
                }
            }
            Scope::Slider
            | Scope::Ball
            | Scope::Touch
            | Scope::Chamber
            | Scope::Reservoir
            | Scope::Passage
            | Scope::Span => mechanism_column(self.frame, quantity)?.get(index?).copied(),
            Scope::Sprocket | Scope::Shaft | Scope::Arm => {
                let (k, r) = (index?, &self.frame.rotors);
                let column = match quantity.what {
                    What::Speed => &r.speed_rad_s,
                    What::Angle => &r.angle_rad,
                    What::Torque => &r.chain_torque_nm,
                    _ => &r.outer_torque_nm,
                };
                column.get(k).copied()
            }
            Scope::Energy => Some(energy_number(quantity.what, &self.frame.energy)),
            Scope::Run => Some(match quantity.what {
                What::Time => self.frame.t_s,
                What::Step => self.frame.step as f64,
                _ => self.frame.crank_angle_rad,
            }),
        }
    }

    fn name(&self, what: What, bound: &BoundRows<'_>) -> Option<u32> {
        if let Some(impact) = bound.impact {
            return impact_name(what, impact);
        }
        let (c, row) = (&self.frame.contacts, bound.contact?);
        match what {
            What::Body => c.body.get(row).copied(),
            What::Feature => c.feature.get(row).copied(),
            What::Segment => c.segment.get(row).copied(),
            _ => None,
        }
    }
}

/// Column of what slides, touches, or holds or passes oil.
fn mechanism_column<'a>(frame: &'a Frame, quantity: &Quantity) -> Option<&'a [f64]> {
    let Frame { sliders, touches, chambers, passages, spans, .. } = frame;
    let (rows, what) = (quantity.scope.named_rows()?.0, quantity.what);
    let column = match rows {
        Rows::Slider => match what {
            What::Position => &sliders.position_m,
            What::Speed => &sliders.speed_m_s,
            What::SpringForce => &sliders.spring_force_n,
            What::OilForce => &sliders.oil_force_n,
            What::TouchForce => &sliders.touch_force_n,
            _ => return None,
        },
        Rows::Touch => match what {
            What::Gap => &touches.gap_m,
            What::NormalForce => &touches.normal_force_n,
            What::TangentialForce => &touches.tangential_force_n,
            What::ApproachSpeed => &touches.approach_speed_m_s,
            What::Age => &touches.age_s,
            _ => return None,
        },
        Rows::Chamber => match what {
            What::Pressure => &chambers.pressure_pa,
            What::Volume => &chambers.volume_m3,
            What::Inflow => &chambers.inflow_m3_s,
            _ => return None,
        },
        Rows::Passage => match what {
            What::Flow => &passages.flow_m3_s,
            What::PressureDrop => &passages.pressure_drop_pa,
            _ => return None,
        },
        Rows::Span => match what {
            What::Tension => &spans.tension_n,
            What::Elongation => &spans.elongation_m,
            What::Power => &spans.power_w,
            _ => return None,
        },
        Rows::Link | Rows::Joint | Rows::Roller | Rows::Contact | Rows::Rotor => return None,
    };
    Some(column)
}

fn energy_number(what: What, e: &Energy) -> f64 {
    match what {
        // No work input yet, so that there is no reference.
        What::Error if e.put_in_j() == 0.0 => 0.0,
        What::Error => e.error_j / e.put_in_j().abs(),
        What::ErrorJ => e.error_j,
        What::Kinetic => e.kinetic_j,
        What::Elastic => e.elastic_j(),
        What::WorkIn => e.put_in_j(),
        What::WorkOut => e.work_out_j,
        _ => e.lost_j(),
    }
}

fn contact_number(frame: &Frame, what: What, row: usize) -> Option<f64> {
    let c = &frame.contacts;
    let column = match what {
        What::Penetration => &c.penetration_m,
        What::NormalForce => &c.normal_force_n,
        What::TangentialForce => &c.tangential_force_n,
        What::ApproachSpeed => &c.approach_speed_m_s,
        What::NormalSpeed => &c.normal_speed_m_s,
        What::TangentialSpeed => &c.tangential_speed_m_s,
        What::Age => &c.age_s,
        What::Stick => return c.stick.get(row).map(|s| f64::from(u8::from(*s))),
        What::Link => return c.link.get(row).map(|l| f64::from(*l)),
        What::Tooth => return c.tooth.get(row).map(|t| f64::from(*t)),
        _ => return None,
    };
    column.get(row).copied()
}

/// Tension of a link: mean of the forces in its front and rear joint along it.
fn tension_n(angle_rad: f64, front_n: (f64, f64), rear_n: (f64, f64)) -> f64 {
    let (s, c) = libm::sincos(angle_rad);
    // The force on the link is opposite to the force in its front joint.
    -0.5 * ((front_n.0 * c + front_n.1 * s) + (rear_n.0 * c + rear_n.1 * s))
}

impl FrameValues<'_> {
    /// The rear joint of a link.
    fn rear_joint(&self, link: usize) -> usize {
        let mut first = 0;
        for n in self.chains {
            if link < first + n {
                return if link == first { first + n - 1 } else { link - 1 };
            }
            first += n;
        }
        link.saturating_sub(1)
    }

    fn link_number(&self, what: What, i: usize) -> Option<f64> {
        let l = &self.frame.links;
        match what {
            What::Tension => {
                let j = &self.frame.joints;
                let force = |joint: usize| Some((*j.force_x_n.get(joint)?, *j.force_y_n.get(joint)?));
                Some(tension_n(*l.angle_rad.get(i)?, force(i)?, force(self.rear_joint(i))?))
            }
            What::Speed => Some(libm::hypot(*l.vx_m_s.get(i)?, *l.vy_m_s.get(i)?)),
            What::VelocityX => l.vx_m_s.get(i).copied(),
            What::VelocityY => l.vy_m_s.get(i).copied(),
            What::Omega => l.omega_rad_s.get(i).copied(),
            What::X => l.x_m.get(i).copied(),
            What::Y => l.y_m.get(i).copied(),
            What::Angle => l.angle_rad.get(i).copied(),
            What::Link => Some(i as f64),
            _ => None,
        }
    }
}
