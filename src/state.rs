//! State: what a step changes, and nothing else.
//!
//! All columns are f64 arrays in chain order, so that a step runs over them without gather, and so that hash, keyframe and
//! resume share one list. The scheme is a leapfrog: positions belong to step `step`, velocities to half a step before it,
//! accelerations to the step before; together they give the velocity at the step itself. Other schemes keep this form, with accelerations of the
//! step itself ([`crate::integrate::scheme`]).
//!
//! Arrays are padded with inert lanes to a multiple of the lane width; what lies behind the last link is neither hashed nor saved.

use crate::aligned::AlignedColumn;
use crate::pairs::contact_group::{CONTACT_GROUPS, ContactGroup};
use crate::recording::frame::{Keyframe, StateColumn};
use std::hash::Hasher;

/// Name of a column: `set.name`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ColumnName {
    pub set: &'static str,
    pub name: &'static str,
}

impl std::fmt::Display for ColumnName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}.{}", self.set, self.name)
    }
}

/// Why a keyframe is not one of this State.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RestoreError {
    /// Another column stands where this one is expected; with the number of values of each.
    OtherColumn { found: String, found_len: usize, expected: ColumnName, expected_len: usize },
    /// The keyframe ends before this column.
    MissingColumn(ColumnName),
    /// All columns fit, but their values are not those that were hashed.
    OtherHash { found: u64, expected: u64 },
}

impl std::fmt::Display for RestoreError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            RestoreError::OtherColumn { found, found_len, expected, expected_len } => write!(
                f,
                "column `{found}` with {found_len} values stands where `{expected}` with {expected_len} is expected: another number of links, or another fidelity"
            ),
            RestoreError::MissingColumn(name) => write!(f, "column `{name}` is missing"),
            RestoreError::OtherHash { found, expected } => {
                write!(f, "the state hashes to {found:016x}, the keyframe says {expected:016x}")
            }
        }
    }
}

impl std::error::Error for RestoreError {}

/// Columns with one value per link.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkState {
    /// Centre of mass [m].
    pub x: AlignedColumn,
    pub y: AlignedColumn,
    /// Heading, rear joint to front joint, as cosine and sine.
    pub cos: AlignedColumn,
    pub sin: AlignedColumn,
    /// Half a step back [m/s, rad/s].
    pub vx: AlignedColumn,
    pub vy: AlignedColumn,
    pub omega: AlignedColumn,
    /// One step back [m/s2, rad/s2].
    pub ax: AlignedColumn,
    pub ay: AlignedColumn,
    pub alpha: AlignedColumn,
    /// The share of the joints in them, as predicted from positions and speeds of that node.
    pub joint_ax: AlignedColumn,
    pub joint_ay: AlignedColumn,
    pub joint_alpha: AlignedColumn,
}

/// What a set of contact lanes remembers from one step to the next, and what it has lost so far.
#[derive(Debug, PartialEq)]
pub struct ContactMemory {
    /// Mean normal force over the last step [N].
    pub normal_force: AlignedColumn,
    /// Mean friction force over the last step [N].
    pub tangential_force: AlignedColumn,
    /// Steps since first touch; 0 = open.
    pub age: AlignedColumn,
    /// Closing speed at first touch [m/s].
    pub approach: AlignedColumn,
    /// Energy lost to contact damping and to friction since the ledger was opened [J].
    pub lost_damping: AlignedColumn,
    pub lost_friction: AlignedColumn,
}

/// One value per coordinate.
#[derive(Clone, Debug, PartialEq)]
pub struct CoordinateState {
    /// Angle [rad], counted on over turns, and its cosine and sine.
    pub angle: Vec<f64>,
    pub cos: Vec<f64>,
    pub sin: Vec<f64>,
    /// Half a step back [rad/s]; one step back [rad/s2].
    pub omega: Vec<f64>,
    pub alpha: Vec<f64>,
    /// Work of what prescribes it, and on its load, since the ledger was opened [J].
    pub work_in: Vec<f64>,
    pub work_out: Vec<f64>,
    /// Lost in dampers and by friction and drag of loads since the ledger was opened [J]. Empty where nothing loses.
    pub lost: Vec<f64>,
    /// What of `lost` was lost by friction and drag of loads, and in dampers of couplings [J]. Empty where neither loses. Not hashed: the sum
    /// is, and States of drives without them keep their hashes.
    pub lost_load: Vec<f64>,
    pub lost_coupling: Vec<f64>,
    /// Likewise in dampers of the spans of chains without links [J].
    pub lost_span: Vec<f64>,
}

/// What the oil of a drive remembers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OilState {
    /// Per chamber: oil in it [m3 at ambient pressure], and its gauge pressure at the node [Pa].
    pub oil_m3: Vec<f64>,
    pub pressure_pa: Vec<f64>,
    /// Per reservoir: oil that has come into it since the recording began [m3], and its work since the ledger was opened [J].
    pub inflow_m3: Vec<f64>,
    pub work_j: Vec<f64>,
    /// Per passage: lost since the ledger was opened [J].
    pub lost_j: Vec<f64>,
}

impl OilState {
    /// For so many chambers, reservoirs and passages.
    pub fn new([chambers, reservoirs, passages]: [usize; 3]) -> OilState {
        OilState {
            oil_m3: vec![0.0; chambers],
            pressure_pa: vec![0.0; chambers],
            inflow_m3: vec![0.0; reservoirs],
            work_j: vec![0.0; reservoirs],
            lost_j: vec![0.0; passages],
        }
    }
}

/// Lengths of a State's columns.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StateLayout {
    /// Lanes of the links of every chain.
    pub loops: Vec<std::ops::Range<usize>>,
    /// Lanes of the rollers of every chain.
    pub rollers: Vec<std::ops::Range<usize>>,
    /// With inert lanes.
    pub padded_len: usize,
    pub n_coordinates: usize,
    pub has_losses: bool,
    /// Whether loads or couplings lose some of it.
    pub has_shaft_losses: bool,
    /// Which groups of contacts there are, in the order of [`ContactGroup::ALL`].
    pub contact_groups: [bool; CONTACT_GROUPS],
    /// Whether spans of chains without links lose some of it.
    pub has_span_losses: bool,
    /// Number of pairs of parts that may touch each other and no chain.
    pub n_touches: usize,
    /// Numbers of chambers, reservoirs and passages of oil.
    pub n_oil: [usize; 3],
}

/// Columns of coordinates that are not hashed.
const SHAFT_LOSSES: [&str; 3] = ["lost_load", "lost_coupling", "lost_span"];

/// Where inert links are put [m]: out of reach of everything.
pub const FAR_AWAY_M: f64 = 1e3;

/// Everything that a step changes.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// Steps since the recording began.
    pub step: u64,
    /// Lanes up to the last link or roller.
    pub lanes: usize,
    pub links: LinkState,
    /// Largest friction torque that every joint could have exerted one step back [N m].
    pub joint_limit: AlignedColumn,
    /// Lost in the pin joints since the ledger was opened, per joint [J].
    pub lost_pin_damping: AlignedColumn,
    pub lost_pin_friction: AlignedColumn,
    /// What of links touches bodies, in the order of [`ContactGroup::ALL`]; by joints (bushes) or links. Empty where a drive has none.
    pub contacts: Vec<ContactMemory>,
    /// Parts that touch each other and no chain, in the order of the Model. Empty where a drive has none.
    pub touches: ContactMemory,
    /// Rollers on their bushes, by the lanes of rollers. Empty where a drive has none.
    pub bores: ContactMemory,
    /// Oil of chambers. Empty where a drive has none.
    pub oil: OilState,
    pub coordinates: CoordinateState,
}

impl Clone for ContactMemory {
    fn clone(&self) -> ContactMemory {
        let mut copy = ContactMemory::new(0);
        copy.clone_from(self);
        copy
    }

    /// Into the columns that there are: steps do this now and then, and ask for no memory.
    fn clone_from(&mut self, from: &ContactMemory) {
        let ContactMemory { normal_force, tangential_force, age, approach, lost_damping, lost_friction } = from;
        self.normal_force.clone_from(normal_force);
        self.tangential_force.clone_from(tangential_force);
        self.age.clone_from(age);
        self.approach.clone_from(approach);
        self.lost_damping.clone_from(lost_damping);
        self.lost_friction.clone_from(lost_friction);
    }
}

impl ContactMemory {
    pub fn new(len: usize) -> ContactMemory {
        let zeros = || AlignedColumn::zeros(len);
        ContactMemory {
            normal_force: zeros(),
            tangential_force: zeros(),
            age: zeros(),
            approach: zeros(),
            lost_damping: zeros(),
            lost_friction: zeros(),
        }
    }

    pub fn is_empty(&self) -> bool {
        self.age.is_empty()
    }
}

impl State {
    /// All links at the origin, at rest; inert lanes far away.
    pub fn at_rest(layout: &StateLayout) -> State {
        let StateLayout {
            padded_len,
            n_coordinates,
            has_losses,
            has_shaft_losses,
            contact_groups,
            has_span_losses,
            n_touches,
            n_oil,
            ..
        } = *layout;
        let zeros = || AlignedColumn::zeros(padded_len);
        let of_coordinates = || vec![0.0; n_coordinates];
        let ends = |side: bool| ContactMemory::new(if side { padded_len } else { 0 });
        let mut x = zeros();
        x.fill(FAR_AWAY_M);
        let bodies = || layout.loops.iter().chain(&layout.rollers).filter(|l| !l.is_empty());
        bodies().for_each(|l| x[l.clone()].fill(0.0));
        let has_rollers = layout.rollers.iter().any(|r| !r.is_empty());
        State {
            step: 0,
            lanes: bodies().map(|l| l.end).max().unwrap_or(0),
            links: LinkState {
                x,
                y: zeros(),
                cos: AlignedColumn::of(1.0, padded_len),
                sin: zeros(),
                vx: zeros(),
                vy: zeros(),
                omega: zeros(),
                ax: zeros(),
                ay: zeros(),
                alpha: zeros(),
                joint_ax: zeros(),
                joint_ay: zeros(),
                joint_alpha: zeros(),
            },
            joint_limit: zeros(),
            lost_pin_damping: zeros(),
            lost_pin_friction: zeros(),
            contacts: contact_groups.map(ends).to_vec(),
            touches: ContactMemory::new(n_touches),
            bores: ends(has_rollers),
            oil: OilState::new(n_oil),
            coordinates: CoordinateState {
                angle: of_coordinates(),
                cos: vec![1.0; n_coordinates],
                sin: of_coordinates(),
                omega: of_coordinates(),
                alpha: of_coordinates(),
                work_in: of_coordinates(),
                work_out: of_coordinates(),
                lost: if has_losses { of_coordinates() } else { Vec::new() },
                lost_load: if has_shaft_losses { of_coordinates() } else { Vec::new() },
                lost_coupling: if has_shaft_losses { of_coordinates() } else { Vec::new() },
                lost_span: if has_span_losses { of_coordinates() } else { Vec::new() },
            },
        }
    }

    /// Every column with its name, the padding cut off. Taken apart without `..`: a new column cannot be forgotten here,
    /// and with it neither in the hash nor in keyframes.
    pub fn for_each_column<'a>(&'a self, mut f: impl FnMut(ColumnName, &'a [f64])) {
        let State {
            step: _,
            lanes,
            links,
            joint_limit,
            lost_pin_damping,
            lost_pin_friction,
            contacts,
            touches,
            bores,
            oil,
            coordinates,
        } = self;
        let n = *lanes;
        let LinkState { x, y, cos, sin, vx, vy, omega, ax, ay, alpha, joint_ax, joint_ay, joint_alpha } = links;
        let named = [
            ("x", x),
            ("y", y),
            ("cos", cos),
            ("sin", sin),
            ("vx", vx),
            ("vy", vy),
            ("omega", omega),
            ("ax", ax),
            ("ay", ay),
            ("alpha", alpha),
            ("joint_ax", joint_ax),
            ("joint_ay", joint_ay),
            ("joint_alpha", joint_alpha),
        ];
        for (name, column) in named {
            f(ColumnName { set: "links", name }, &column[..n]);
        }
        f(ColumnName { set: "joints", name: "friction_limit" }, &joint_limit[..n]);
        f(ColumnName { set: "joints", name: "lost_pin_damping" }, &lost_pin_damping[..n]);
        f(ColumnName { set: "joints", name: "lost_pin_friction" }, &lost_pin_friction[..n]);
        let of_links = ContactGroup::ALL.into_iter().map(ContactGroup::name).zip(contacts);
        let more = [("touches", touches), ("bores", bores)].into_iter().filter(|(_, memory)| !memory.is_empty());
        for (set, memory) in of_links.chain(more) {
            let ContactMemory { normal_force, tangential_force, age, approach, lost_damping, lost_friction } = memory;
            let named = [
                ("normal_force", normal_force),
                ("tangential_force", tangential_force),
                ("age", age),
                ("approach", approach),
                ("lost_damping", lost_damping),
                ("lost_friction", lost_friction),
            ];
            for (name, column) in named {
                f(ColumnName { set, name }, &column[..n.min(column.len())]);
            }
        }
        let CoordinateState {
            angle,
            cos,
            sin,
            omega,
            alpha,
            work_in,
            work_out,
            lost,
            lost_load,
            lost_coupling,
            lost_span,
        } = coordinates;
        let named = [
            ("angle", angle),
            ("cos", cos),
            ("sin", sin),
            ("omega", omega),
            ("alpha", alpha),
            ("work_in", work_in),
            ("work_out", work_out),
            ("lost_damping", lost),
        ];
        for (name, column) in named {
            f(ColumnName { set: "coordinates", name }, column);
        }
        for (name, column) in
            SHAFT_LOSSES.into_iter().zip([lost_load, lost_coupling, lost_span]).filter(|(_, c)| !c.is_empty())
        {
            f(ColumnName { set: "coordinates", name }, column);
        }
        let OilState { oil_m3, pressure_pa, inflow_m3, work_j, lost_j } = oil;
        let named = [
            ("volume", oil_m3),
            ("pressure", pressure_pa),
            ("inflow", inflow_m3),
            ("work_reservoir", work_j),
            ("lost_flow", lost_j),
        ];
        for (name, column) in named.into_iter().filter(|_| !oil_m3.is_empty()) {
            f(ColumnName { set: "oil", name }, column);
        }
    }

    /// XXH3-64 of the step number and of every column's bits, in the order of [`State::for_each_column`]; without those that only say
    /// which part of the losses is whose.
    pub fn hash(&self) -> u64 {
        let mut hasher = twox_hash::XxHash3_64::new();
        hasher.write(&self.step.to_le_bytes());
        self.for_each_column(|name, column| {
            if !SHAFT_LOSSES.contains(&name.name) {
                hasher.write(bytemuck::cast_slice(column));
            }
        });
        hasher.finish()
    }

    /// What a group of contacts remembers.
    #[inline(always)]
    pub fn memory_mut(&mut self, part: ContactGroup) -> &mut ContactMemory {
        &mut self.contacts[part.index()]
    }

    /// The whole State as a message.
    pub fn keyframe(&self) -> Keyframe {
        let mut columns = Vec::new();
        self.for_each_column(|name, values| {
            columns.push(StateColumn { name: name.to_string(), values: values.to_vec() })
        });
        Keyframe { step: self.step, state_hash: self.hash(), columns }
    }

    /// Puts a keyframe back into a State of the same drive. Fails when columns differ in name, number or length, or when
    /// the hash does not match.
    pub fn restore(&mut self, keyframe: &Keyframe) -> Result<(), RestoreError> {
        let mut given = keyframe.columns.iter();
        let mut problem = None;
        self.for_each_column_mut(|name, column| match given.next() {
            Some(c) if c.name == name.to_string() && c.values.len() == column.len() => {
                column.copy_from_slice(&c.values)
            }
            Some(c) => {
                problem.get_or_insert_with(|| RestoreError::OtherColumn {
                    found: c.name.clone(),
                    found_len: c.values.len(),
                    expected: name,
                    expected_len: column.len(),
                });
            }
            None => {
                problem.get_or_insert(RestoreError::MissingColumn(name));
            }
        });
        if let Some(problem) = problem {
            return Err(problem);
        }
        self.step = keyframe.step;
        let hash = self.hash();
        if hash != keyframe.state_hash {
            return Err(RestoreError::OtherHash { found: hash, expected: keyframe.state_hash });
        }
        Ok(())
    }

    /// Mutable twin of [`State::for_each_column`]; a test holds their order together.
    fn for_each_column_mut(&mut self, mut f: impl FnMut(ColumnName, &mut [f64])) {
        let mut names = Vec::new();
        self.for_each_column(|name, _| names.push(name));
        let n = self.lanes;
        let State {
            step: _,
            lanes: _,
            links,
            joint_limit,
            lost_pin_damping,
            lost_pin_friction,
            contacts,
            touches,
            bores,
            oil,
            coordinates,
        } = self;
        let LinkState { x, y, cos, sin, vx, vy, omega, ax, ay, alpha, joint_ax, joint_ay, joint_alpha } = links;
        let mut columns: Vec<&mut [f64]> =
            vec![x, y, cos, sin, vx, vy, omega, ax, ay, alpha, joint_ax, joint_ay, joint_alpha];
        columns.extend([joint_limit, lost_pin_damping, lost_pin_friction].map(|c| &mut **c));
        let more = [touches, bores].into_iter().filter(|memory| !memory.is_empty());
        for memory in contacts.iter_mut().chain(more) {
            let ContactMemory { normal_force, tangential_force, age, approach, lost_damping, lost_friction } = memory;
            let own = [normal_force, tangential_force, age, approach, lost_damping, lost_friction];
            columns.extend(own.map(|c| &mut **c));
        }
        let per_link = columns.len();
        let CoordinateState {
            angle,
            cos,
            sin,
            omega,
            alpha,
            work_in,
            work_out,
            lost,
            lost_load,
            lost_coupling,
            lost_span,
        } = coordinates;
        columns.extend([angle, cos, sin, omega, alpha, work_in, work_out, lost].map(Vec::as_mut_slice));
        let more = [lost_load, lost_coupling, lost_span].map(Vec::as_mut_slice);
        columns.extend(more.into_iter().filter(|c| !c.is_empty()));
        let OilState { oil_m3, pressure_pa, inflow_m3, work_j, lost_j } = oil;
        columns.extend([oil_m3, pressure_pa, inflow_m3, work_j, lost_j].map(Vec::as_mut_slice));
        for (i, (name, column)) in names.into_iter().zip(columns).enumerate() {
            let len = if i < per_link { n.min(column.len()) } else { column.len() };
            f(name, &mut column[..len]);
        }
    }

    /// The same motion for another step: velocities and speeds belong half a step before the positions.
    pub fn restep(&mut self, old_step_s: f64, new_step_s: f64) {
        let shift = 0.5 * (old_step_s - new_step_s);
        let l = &mut self.links;
        for (velocity, acceleration) in [(&mut l.vx, &l.ax), (&mut l.vy, &l.ay), (&mut l.omega, &l.alpha)] {
            for (v, a) in velocity.iter_mut().zip(acceleration) {
                *v += shift * a;
            }
        }
        for (omega, alpha) in self.coordinates.omega.iter_mut().zip(&self.coordinates.alpha) {
            *omega += shift * alpha;
        }
    }

    /// Opens a new ledger: losses and work start from zero.
    pub fn clear_ledger(&mut self) {
        self.for_each_column_mut(|name, column| {
            if name.name.starts_with("lost_") || name.name.starts_with("work_") || name.name == "inflow" {
                column.fill(0.0);
            }
        });
    }

    /// First link, joint, coordinate or chamber with a value that is no finite number. What contacts remember is not looked through: their
    /// forces are in the accelerations.
    pub fn first_not_finite(&self) -> Option<String> {
        let LinkState { x, y, cos, sin, vx, vy, omega, ax, ay, alpha, joint_ax, joint_ay, joint_alpha } = &self.links;
        let links = [x, y, cos, sin, vx, vy, omega, ax, ay, alpha, joint_ax, joint_ay, joint_alpha];
        let CoordinateState { angle, omega, alpha, work_in, work_out, .. } = &self.coordinates;
        let others: [&[f64]; 7] = [&self.joint_limit, angle, omega, alpha, work_in, work_out, &self.oil.pressure_pa];
        if links.iter().all(|column| are_finite(column)) && others.iter().all(|column| are_finite(column)) {
            return None;
        }
        let mut found = None;
        self.for_each_column(|name, column| {
            if found.is_none() {
                found = column.iter().position(|v| !v.is_finite()).map(|i| format!("{name}[{i}]"));
            }
        });
        found
    }
}

/// Zero times a number is zero, unless it is no finite one: many are looked at together, without a way out half-way.
fn are_finite(column: &[f64]) -> bool {
    const WIDTH: usize = 8;
    let (blocks, rest) = column.as_chunks::<WIDTH>();
    let mut sums = [0.0; WIDTH];
    for block in blocks {
        for i in 0..WIDTH {
            sums[i] += 0.0 * block[i];
        }
    }
    sums.iter().chain(rest).all(|v| 0.0 * v == 0.0)
}
