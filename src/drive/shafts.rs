//! Shafts of a drive with links: how the driver turns, loads and couplings. Their keys, units and ranges.
//!
//! ```text
//! [speeds.constant.NAME]  speed_rpm                                  and orders, amplitudes_deg, phases_deg
//! [speeds.table.NAME]     times_s, speeds_rpm                        likewise
//! [loads.orders.NAME]     body, orders, torques_nm, phases_deg       orders of the driver's turn
//! [loads.LAW.NAME]        body, parameters of the law's effect       viscous, quadratic, friction, stribeck, harmonic
//! [couplings.NAME]        between, stiffness_nm_per_rad, damping_nm_s_per_rad
//! ```

use super::effects::parameters;
use super::mechanism::SliderSpec;
use super::reader::TomlTable;
use super::{ArmSpec, Drive, OuterSpec, ShaftSpec, SprocketDrive};
use crate::diag::Report;
use crate::effects::{EFFECTS, Effect, LOADS, MotionLaw, On, Physics};
use crate::elements::driver_motion::Harmonic;
use crate::units::{DEG, RPM};

/// How the driver turns.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct MotionSpec {
    /// Time [s] and speed [rad/s]; one where it is constant.
    pub speeds: Vec<(f64, f64)>,
    /// Amplitudes as angles [rad].
    pub harmonics: Vec<Harmonic>,
    /// Effects on the driver's speed: their laws, and the values of their parameters [SI].
    pub fluctuations: Vec<(MotionLaw, Vec<f64>)>,
}

impl MotionSpec {
    /// Whether it is more than a constant speed.
    pub fn varies(&self) -> bool {
        self.speeds.len() > 1 || !self.harmonics.is_empty() || !self.fluctuations.is_empty()
    }
}

/// What a load or a coupling acts on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moving {
    /// The sprocket with this index.
    Sprocket(usize),
    /// The shaft with this index.
    Shaft(usize),
    /// The arm with this index.
    Arm(usize),
    /// The slider with this index.
    Slider(usize),
}

/// A load by a law of the catalogue.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadSpec {
    /// Path in the file: `loads.LAW.NAME`.
    pub path: String,
    /// What it acts on.
    pub on: Moving,
    /// Row of the catalogue.
    pub effect: &'static Effect,
    /// Values of the row's parameters, SI.
    pub values: Vec<f64>,
}

/// A load by orders of the driver's turn, amplitudes as torques [N m].
#[derive(Clone, Debug, PartialEq)]
pub struct OrderLoadSpec {
    /// Path in the file: `loads.orders.NAME`.
    pub path: String,
    /// What it acts on.
    pub on: Moving,
    /// Orders of the driver's turn, with their phases.
    pub harmonics: Vec<Harmonic>,
}

/// A torsion spring between two sprockets or shafts.
#[derive(Clone, Debug, PartialEq)]
pub struct CouplingSpec {
    /// Path in the file: `couplings.NAME`.
    pub path: String,
    /// Its two ends.
    pub between: [Moving; 2],
    /// Torsional stiffness [N m/rad].
    pub stiffness_nm_per_rad: f64,
    /// Torsional damping [N m s/rad].
    pub damping_nm_s_per_rad: f64,
}

/// All that acts on shafts besides constant speeds and constant loads.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShaftTrain {
    /// How the driver turns.
    pub motion: MotionSpec,
    /// Loads by laws of the catalogue.
    pub loads: Vec<LoadSpec>,
    /// Loads by orders of the driver's turn.
    pub order_loads: Vec<OrderLoadSpec>,
    /// Torsion springs between sprockets or shafts.
    pub couplings: Vec<CouplingSpec>,
}

/// The tables `[speeds]`, while sprockets and shafts are read.
pub(super) struct Speeds<'t> {
    constant: TomlTable<'t>,
    table: TomlTable<'t>,
    whole: TomlTable<'t>,
}

impl<'t> Speeds<'t> {
    pub(super) fn new(root: &TomlTable<'t>) -> Speeds<'t> {
        let whole = root.table("speeds");
        Speeds { constant: whole.table("constant"), table: whole.table("table"), whole }
    }

    /// Whether the speed of `name` is prescribed.
    pub(super) fn has(&self, name: &str) -> bool {
        self.constant.table(name).is_present() || self.table.table(name).is_present()
    }

    /// How `name` turns.
    pub(super) fn read(&self, name: &str) -> MotionSpec {
        let (constant, table) = (self.constant.table(name), self.table.table(name));
        let t = if constant.is_present() { &constant } else { &table };
        if constant.is_present() && table.is_present() {
            table.error(format!("`{name}` has two speeds"), Some("keep one of constant and table".into()));
        }
        let speeds = if constant.is_present() {
            vec![(0.0, constant.required("speed_rpm", RPM, -1e5..=1e5))]
        } else {
            speed_table(&table)
        };
        let harmonics = harmonics(t, "amplitudes_deg", DEG, -90.0..=90.0);
        constant.finish();
        table.finish();
        MotionSpec { speeds, harmonics, fluctuations: Vec::new() }
    }

    pub(super) fn finish(&self) {
        [&self.constant, &self.table, &self.whole].iter().for_each(|t| t.finish());
    }
}

/// `times_s` and `speeds_rpm`.
fn speed_table(t: &TomlTable<'_>) -> Vec<(f64, f64)> {
    let times = t.list("times_s", 1.0, -1e6..=1e6).unwrap_or_default();
    let speeds = t.list("speeds_rpm", RPM, -1e5..=1e5).unwrap_or_default();
    if times.len() != speeds.len() || times.is_empty() {
        t.error(
            format!("{} times, {} speeds", times.len(), speeds.len()),
            Some("give as many `speeds_rpm` as `times_s`, at least one".into()),
        );
        return vec![(0.0, 1.0)];
    }
    if let Some(i) = times.windows(2).position(|w| w[1] <= w[0]) {
        t.error_at("times_s", format!("time {} s does not come after {} s", times[i + 1], times[i]), None);
        return vec![(0.0, 1.0)];
    }
    if speeds[0] == 0.0 {
        t.error_at(
            "speeds_rpm",
            "the first speed is zero".into(),
            Some("a drive is run in at its first speed: begin with a slow one".into()),
        );
    }
    times.into_iter().zip(speeds).collect()
}

/// What is said of `orders` without `phases_deg`.
pub const ORDERS_WITHOUT_PHASES: &str = "orders without phases";

/// `orders` with amplitudes and `phases_deg`.
fn harmonics(t: &TomlTable<'_>, key: &str, unit: f64, range: std::ops::RangeInclusive<f64>) -> Vec<Harmonic> {
    let orders = t.list("orders", 1.0, 0.01..=1000.0).unwrap_or_default();
    let amplitudes = t.list(key, unit, range).unwrap_or_default();
    let phases = t.list("phases_deg", DEG, -3600.0..=3600.0).unwrap_or_default();
    if !orders.is_empty() && !t.has("phases_deg") {
        let zeros = vec!["0"; orders.len()].join(", ");
        t.error_at("orders", ORDERS_WITHOUT_PHASES.into(), Some(format!("add `phases_deg = [{zeros}]`")));
        return Vec::new();
    }
    if orders.len() != amplitudes.len() || orders.len() != phases.len() {
        let counts = format!("{} orders, {} {key}, {} phases_deg", orders.len(), amplitudes.len(), phases.len());
        t.error(counts, Some("give as many of each".into()));
        return Vec::new();
    }
    let rows = orders.into_iter().zip(amplitudes).zip(phases);
    rows.map(|((order, amplitude), phase_rad)| Harmonic { order, amplitude, phase_rad }).collect()
}

/// Names of all that moves.
pub(super) struct MovingNames<'a> {
    pub(super) sprockets: &'a [SprocketDrive],
    pub(super) shafts: &'a [ShaftSpec],
    pub(super) arms: &'a [ArmSpec],
    pub(super) sliders: &'a [SliderSpec],
}

impl MovingNames<'_> {
    pub(super) fn find(&self, name: &str) -> Option<Moving> {
        let sprocket = self.sprockets.iter().position(|s| s.name == name).map(Moving::Sprocket);
        let shaft = || self.shafts.iter().position(|s| s.name == name).map(Moving::Shaft);
        let arm = || self.arms.iter().position(|a| a.name == name).map(Moving::Arm);
        let slider = || self.sliders.iter().position(|s| s.name == name).map(Moving::Slider);
        sprocket.or_else(shaft).or_else(arm).or_else(slider)
    }

    fn all(&self) -> String {
        let shafts = self.shafts.iter().map(|s| s.name.as_str());
        let others = self.arms.iter().map(|a| a.name.as_str()).chain(self.sliders.iter().map(|s| s.name.as_str()));
        self.sprockets.iter().map(|s| s.name.as_str()).chain(shafts).chain(others).collect::<Vec<_>>().join(", ")
    }

    /// The moving part that `name` means; an error of `t` where there is none.
    pub(super) fn required(&self, t: &TomlTable<'_>, name: &str) -> Moving {
        self.find(name).unwrap_or_else(|| {
            t.error(format!("nothing that moves is called `{name}`"), Some(format!("there are: {}", self.all())));
            Moving::Sprocket(0)
        })
    }

    fn is_prescribed(&self, on: Moving) -> bool {
        let prescribed = |outer: &OuterSpec| matches!(outer, OuterSpec::Speed { .. });
        match on {
            Moving::Sprocket(k) => self.sprockets.get(k).is_some_and(|s| prescribed(&s.outer)),
            Moving::Shaft(k) => self.shafts.get(k).is_some_and(|s| prescribed(&s.outer)),
            Moving::Arm(_) | Moving::Slider(_) => false,
        }
    }
}

/// Loads by laws and by orders: `[loads]` without `[loads.constant]`.
pub(super) fn read_loads(loads: &TomlTable<'_>, names: &MovingNames<'_>, train: &mut ShaftTrain) {
    for (kind, effect) in LOADS.into_iter().filter(|(kind, _)| *kind != "constant") {
        let table = loads.table(kind);
        for (name, t) in table.tables_or_set() {
            let on = t.text("body").unwrap_or(name);
            read_load(&t, effect, &on, names, train);
        }
        table.finish();
    }
    let table = loads.table("orders");
    for (name, t) in table.tables() {
        let on = names.required(&t, &t.text("body").unwrap_or(name));
        if matches!(on, Moving::Slider(_)) {
            t.error("a slider takes no torque".into(), Some("put it on a sprocket, a shaft or an arm".into()));
        }
        let harmonics = harmonics(&t, "torques_nm", 1.0, -1e6..=1e6);
        if harmonics.is_empty() && !t.has("orders") {
            t.error(
                "no `orders`".into(),
                Some("add `orders = [...]`, `torques_nm = [...]`, `phases_deg = [...]`".into()),
            );
        }
        train.order_loads.push(OrderLoadSpec { path: t.path().to_string(), on, harmonics });
        t.finish();
    }
    table.finish();
}

/// Effects on shafts, arms and sliders: `[effects.NAME.BODY]`.
pub(super) fn read_effects(effects: &TomlTable<'_>, names: &MovingNames<'_>, train: &mut ShaftTrain) {
    for effect in EFFECTS {
        if effect.links == Some(On::Body) {
            let table = effects.table(effect.name);
            for (name, t) in table.tables_or_set() {
                read_load(&t, effect, name.trim_end_matches('+'), names, train);
            }
            table.finish();
        }
        if let (Some(On::Prescribed), Physics::Motion(law)) = (effect.links, effect.physics) {
            let table = effects.table(effect.name);
            for (name, t) in table.tables_or_set() {
                let on = names.required(&t, name.trim_end_matches('+'));
                if !names.is_prescribed(on) {
                    t.error(
                        format!("no speed is prescribed for `{name}`"),
                        Some("put it on the sprocket or shaft with a speed".into()),
                    );
                }
                train.motion.fluctuations.push((law, parameters(&t, effect, false)));
                t.finish();
            }
            table.finish();
        }
    }
}

fn read_load(t: &TomlTable<'_>, effect: &'static Effect, name: &str, names: &MovingNames<'_>, train: &mut ShaftTrain) {
    let on = names.required(t, name);
    if names.is_prescribed(on) {
        t.error(
            format!("`{name}` has a prescribed speed, no load changes its motion"),
            Some("put the load on what moves freely".into()),
        );
    }
    let slides = matches!(on, Moving::Slider(_));
    let values = parameters(t, effect, slides);
    train.loads.push(LoadSpec { path: t.path().to_string(), on, effect, values });
    t.finish();
}

/// `[couplings.NAME]`.
pub(super) fn read_couplings(root: &TomlTable<'_>, names: &MovingNames<'_>) -> Vec<CouplingSpec> {
    let table = root.table("couplings");
    let mut all = Vec::new();
    for (name, t) in table.tables() {
        let ends = t.texts("between").unwrap_or_default();
        let stiffness_nm_per_rad = t.required("stiffness_nm_per_rad", 1.0, 1e-6..=1e9);
        let damping_nm_s_per_rad = t.number("damping_nm_s_per_rad", 1.0, 0.0..=1e6).unwrap_or(0.0);
        if let [a, b] = &ends[..] {
            let between = [names.required(&t, a), names.required(&t, b)];
            if between.iter().any(|m| matches!(m, Moving::Arm(_) | Moving::Slider(_))) {
                t.error_at("between", "a coupling joins sprockets or shafts".into(), None);
            }
            if names.same_shaft(between) {
                t.error_at("between", format!("`{a}` and `{b}` turn together already"), None);
            }
            let path = format!("couplings.{name}");
            all.push(CouplingSpec { path, between, stiffness_nm_per_rad, damping_nm_s_per_rad });
        } else {
            t.error(format!("coupling `{name}` needs two ends"), Some("add `between = [\"a\", \"b\"]`".into()));
        }
        t.finish();
    }
    table.finish();
    all
}

impl MovingNames<'_> {
    /// Whether two parts turn by one coordinate.
    fn same_shaft(&self, between: [Moving; 2]) -> bool {
        let shaft = |m: Moving| match m {
            Moving::Sprocket(k) => self.sprockets.get(k).and_then(|s| s.shaft).map_or(m, Moving::Shaft),
            Moving::Shaft(_) | Moving::Arm(_) | Moving::Slider(_) => m,
        };
        shaft(between[0]) == shaft(between[1])
    }
}

/// Names of what sensors of turning read: sprockets, shafts without sprockets, arms.
pub(super) fn turning_names(sprockets: &[SprocketDrive], shafts: &[ShaftSpec], arms: &[ArmSpec]) -> Vec<String> {
    let bare = bare_shafts(sprockets, shafts).into_iter().map(|k| &shafts[k].name);
    sprockets.iter().map(|s| &s.name).chain(bare).chain(arms.iter().map(|a| &a.name)).cloned().collect()
}

/// Indices of the shafts that no sprocket sits on.
fn bare_shafts(sprockets: &[SprocketDrive], shafts: &[ShaftSpec]) -> Vec<usize> {
    (0..shafts.len()).filter(|k| sprockets.iter().all(|s| s.shaft != Some(*k))).collect()
}

impl Drive {
    /// Indices of the shafts that no sprocket sits on.
    pub fn bare_shafts(&self) -> Vec<usize> {
        bare_shafts(&self.sprockets, &self.shafts)
    }

    /// Checks of shafts without sprockets, couplings and loads.
    pub(super) fn check_train(&self) -> Result<(), Report> {
        let mut found = Vec::new();
        let mut add = |path: String, title: String, help: &str| {
            found.push(self.places.error(&path, title, Some(help.to_string())));
        };
        for k in self.bare_shafts() {
            let (name, outer) = (&self.shafts[k].name, self.shafts[k].outer);
            if matches!(outer, OuterSpec::Speed { .. }) {
                let help = "prescribe the speed of a sprocket, or of a shaft that carries one";
                add(format!("shafts.{name}"), format!("shaft `{name}` has a speed and no sprocket"), help);
            }
            if self.train.couplings.iter().all(|c| !c.between.contains(&Moving::Shaft(k))) {
                let help = "give a sprocket this `shaft`, or add a coupling (`[couplings.NAME]`)";
                add(format!("shafts.{name}"), format!("no sprocket sits on shaft `{name}`"), help);
            }
        }
        let coupled = |k: usize| self.train.couplings.iter().any(|c| c.between.contains(&Moving::Shaft(k)));
        let apart = |k: &usize| coupled(*k) && self.sprocket_turning(Moving::Shaft(*k)).is_none();
        if let Some(k) = self.bare_shafts().into_iter().find(apart) {
            let name = &self.shafts[k].name;
            let help = "lead the couplings to a shaft that carries a sprocket";
            add(format!("shafts.{name}"), format!("nothing turns shaft `{name}`"), help);
        }
        if found.is_empty() { Ok(()) } else { Err(self.places.report(found)) }
    }

    /// The sprocket that a part turns as fast as: itself, one on the shaft, or one behind couplings; None: it does not turn on.
    pub fn sprocket_turning(&self, part: Moving) -> Option<usize> {
        let on = |m: Moving| match m {
            Moving::Sprocket(k) => Some(k),
            Moving::Shaft(k) => self.sprockets.iter().position(|s| s.shaft == Some(k)),
            Moving::Arm(_) | Moving::Slider(_) => None,
        };
        let mut reached = vec![part];
        let mut next = 0;
        while let Some(m) = reached.get(next).copied() {
            if on(m).is_some() {
                return on(m);
            }
            for [a, b] in self.train.couplings.iter().map(|c| c.between) {
                let other = if a == m { b } else { a };
                if (a == m || b == m) && !reached.contains(&other) {
                    reached.push(other);
                }
            }
            next += 1;
        }
        None
    }
}
