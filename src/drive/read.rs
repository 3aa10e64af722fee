//! Reading a drive file, table by table: which keys there are, their units and ranges. A key that nothing here asks for is
//! unknown.

use super::bearings::{self, CarriedNames};
use super::contacts::{DEFAULT_CONTACT_LENGTH_M, GuideTables, read_contact, read_contacts};
use super::guides::{read_guides, read_rails};
use super::reader::{Places, TomlTable};
use super::shafts::{self, MotionSpec, MovingNames, ShaftTrain, Speeds};
use super::valves::{self, CamCarriers};
use super::{
    ArmSpec, ChainFidelity, ChainPart, ChainSpec, Drive, FaceForm, JointSpec, OuterSpec, PreloadSpec, RailSpec,
    RingForm, RunSpec, ScatterSpec, Scheme, ShaftSpec, SpanSpec, SprocketDrive,
};
use super::{effects, lifters, mechanism, sensors, torsion};
use crate::geometry::chain::abutment::{AbutmentChain, Handover};
use crate::geometry::chain::bush::{BushChain, RollerSpec, RowSpec};
use crate::geometry::chain::silent::{SilentChain, SilentLinkForm, SilentRowSpec};
use crate::geometry::route::Wrap;
use crate::geometry::smartchain::{Inclination, TwoLinks};
use crate::geometry::sprocket::{GapForm, TEETH_RANGE};
use crate::units::{MM, UM};
use std::f64::consts::PI;
use std::sync::Arc;

/// Reads everything; mistakes are kept by the reader and the returned values are then of no use.
pub(super) fn drive(root: &TomlTable<'_>) -> Drive {
    let [title, source] = ["title", "source"].map(|key| root.text(key).unwrap_or_default());
    // The other one is read by `machine`.
    root.choice("fidelity", &[("links", ())]);
    let several = root.table("chains");
    let chains = several.tables();
    let loads = root.table("loads");
    let (sprockets, shafts, motion) = read_sprockets(root, &chains, &loads.table("constant"));
    let names: Vec<String> = sprockets.iter().map(|s| s.name.clone()).collect();
    let own = |chain: usize| -> Vec<String> {
        sprockets.iter().filter(|s| s.chain == chain).map(|s| s.name.clone()).collect()
    };
    // What is the drive's own where it has one chain stands in the chain's table where it has several.
    let first = chains.first().map_or(root, |(_, t)| t);
    let (chain, links, scatter, joint) = read_links(&first.table("chain"));
    let fidelities: Vec<ChainFidelity> = chains.iter().map(|(_, t)| read_fidelity(t)).collect();
    let fidelity = fidelities.first().copied().unwrap_or(ChainFidelity::Links);
    let guide_tables = root.table("guides");
    let guides_here =
        GuideTables { has_any: guide_tables.is_present(), has_rails: guide_tables.table("rail").is_present() };
    let contacts = first.table("contact");
    let [stop_table, tip_table, cam_table, seat_table] =
        ["stop", "tip", "cam", "seat"].map(|name| contacts.table(name));
    let ([tooth_contact, guide_contact, ring_contact], roller_contact) =
        read_contacts(&first.table("contact"), &chain, guides_here);
    let read = |t: &TomlTable<'_>| read_contact(t, DEFAULT_CONTACT_LENGTH_M);
    let arms = mechanism::read_arms(root, &names);
    let stop_contact = mechanism::read_stops(&stop_table, &arms, read);
    let sliders = mechanism::read_sliders(root, &names, &arms);
    let tip_contact = mechanism::read_tips(&tip_table, &sliders, read);
    let mut oil = mechanism::read_oil(root, &sliders, valves::have_lifters(root));
    let moving = MovingNames { sprockets: &sprockets, shafts: &shafts, arms: &arms, sliders: &sliders };
    let mut train = ShaftTrain { motion, couplings: shafts::read_couplings(root, &moving), ..ShaftTrain::default() };
    let elastic_shafts = torsion::read_elastic_shafts(root, &moving);
    shafts::read_loads(&loads, &moving, &mut train);
    loads.finish();
    let effect_table = root.table("effects");
    shafts::read_effects(&effect_table, &moving, &mut train);
    let guide_table = root.table("guides");
    let spans: Vec<Vec<String>> = (0..chains.len().max(1)).map(own).collect();
    let guides = read_guides(&guide_table, &spans);
    let taken: Vec<String> = names.iter().cloned().chain(guides.iter().map(|g| g.name.clone())).collect();
    let rails = read_rails(&guide_table, &spans, &arms, &taken);
    guide_table.finish();
    let carried = CarriedNames { sprockets: &sprockets, shafts: &shafts, guides: &guides, rails: &rails };
    let bearings = bearings::read_bearings(root, &carried);
    let blades = |chain: usize| -> Vec<&str> {
        let on_chain = |r: &&RailSpec| sprockets.get(r.span).is_some_and(|s| s.chain == chain);
        rails.iter().filter(on_chain).filter(|r| r.bending.is_some()).map(|r| r.name.as_str()).collect()
    };
    let carriers = CamCarriers {
        sprockets: &sprockets,
        shafts: &shafts,
        elastic_shafts: &elastic_shafts,
        bearings: &bearings,
        oil: oil.as_ref(),
    };
    let valves = valves::read_valves(root, &carriers);
    if let Some(oil) = &mut oil {
        lifters::add_oil(root, oil, &valves::lifters(&valves));
        lifters::check_islands(root, oil);
    }
    let valve_contacts = valves::read_valve_contacts([&cam_table, &seat_table], &valves, read);
    let preload = read_preload(&first.table("preload"), &own(0), 0, (&arms, &blades(0)));
    let more = |(index, (_, t)): (usize, &(String, TomlTable<'_>))| {
        let before = (0..index).map(|c| own(c).len()).sum();
        read_chain_part(t, (fidelities[index], guides_here), |preload| {
            read_preload(preload, &own(index), before, (&arms, &blades(index)))
        })
    };
    let more: Vec<ChainPart> = chains.iter().enumerate().skip(1).map(more).collect();
    let of_spans = |chain: usize| read_spans(&chains[chain].1, chain, fidelities[chain], &own(chain));
    let span_numbers: Vec<SpanSpec> = (0..chains.len()).flat_map(of_spans).collect();
    chains.iter().for_each(|(_, t)| t.finish());
    let chain_names = chains.iter().map(|(name, _)| name.clone()).collect();
    several.finish();
    let driver = sprockets.iter().find(|s| matches!(s.outer, OuterSpec::Speed { .. })).map(|s| s.name.clone());
    let sensed = mechanism::parts(&sliders, (valves::names(&valves), &elastic_shafts), oil.as_ref());
    // In the order of the bodies: guides, then rails.
    let guide_names: Vec<&str> =
        guides.iter().map(|g| g.name.as_str()).chain(rails.iter().map(|r| r.name.as_str())).collect();
    let turning = shafts::turning_names(&sprockets, &shafts, &arms);
    let targets = sensors::SensorTargets {
        spans: &spans,
        turning: &turning,
        driver: driver.as_deref(),
        guides: &guide_names,
        parts: &sensed,
    };
    let sensors = sensors::sensors(root, targets);
    let of_spans = fidelities.iter().zip(&spans).filter(|(fidelity, _)| **fidelity == ChainFidelity::Spans);
    let of_spans: Vec<String> = of_spans.flat_map(|(_, own)| span_names(own)).collect();
    let parts = effects::named_parts(&rails, &bearings, &valves, &train.couplings);
    let targets = effects::EffectTargets {
        sprockets: &names,
        guides: &guide_names[..guides.len()],
        rails: &rails,
        arms: &arms,
        oil: oil.as_ref(),
        parts: &parts,
        spans: &of_spans,
    };
    let (effects, signals) = effects::read_effects(&effect_table, targets, &sensors);
    let run = read_run(&root.table("run"));
    root.finish();
    let (places, document) = (Places::empty(), Arc::default());
    let (name, text, overrides) = (String::new(), String::new(), Vec::new());
    Drive {
        name,
        text,
        overrides,
        title,
        source,
        chain,
        links,
        fidelity,
        scatter,
        joint,
        tooth_contact,
        guide_contact,
        ring_contact,
        roller_contact,
        stop_contact,
        more,
        chain_names,
        spans: span_numbers,
        shafts,
        elastic_shafts,
        bearings,
        train,
        sprockets,
        guides,
        arms,
        sliders,
        tip_contact,
        oil,
        valves,
        valve_contacts,
        rails,
        preload,
        effects,
        sensors,
        signals,
        run,
        places,
        document,
    }
}

/// A chain behind the first.
fn read_chain_part(
    t: &TomlTable<'_>,
    (fidelity, guides_here): (ChainFidelity, GuideTables),
    preload: impl Fn(&TomlTable<'_>) -> PreloadSpec,
) -> ChainPart {
    let (chain, links, scatter, joint) = read_links(&t.table("chain"));
    let ([tooth_contact, guide_contact, ring_contact], roller_contact) =
        read_contacts(&t.table("contact"), &chain, guides_here);
    let preload = preload(&t.table("preload"));
    ChainPart {
        chain,
        links,
        scatter,
        joint,
        tooth_contact,
        guide_contact,
        ring_contact,
        roller_contact,
        preload,
        fidelity,
    }
}

/// What a chain of several is made of.
fn read_fidelity(t: &TomlTable<'_>) -> ChainFidelity {
    let kinds = [("links", ChainFidelity::Links), ("spans", ChainFidelity::Spans)];
    t.choice("fidelity", &kinds).unwrap_or(ChainFidelity::Links)
}

/// Names of the spans of a chain with these sprockets.
fn span_names(sprockets: &[String]) -> impl Iterator<Item = String> + '_ {
    let next = sprockets.iter().cycle().skip(1);
    sprockets.iter().zip(next).map(|(from, to)| format!("{from}-{to}"))
}

/// Numbers of spans that the file gives: `[chains.NAME.spans.FROM-TO]`.
fn read_spans(t: &TomlTable<'_>, chain: usize, fidelity: ChainFidelity, sprockets: &[String]) -> Vec<SpanSpec> {
    let table = t.table("spans");
    let mut all = Vec::new();
    for (name, own) in table.tables_or_set() {
        if span_names(sprockets).all(|known| known != name) {
            let known: Vec<String> = span_names(sprockets).collect();
            own.error(format!("no span is called `{name}`"), Some(format!("spans: {}", known.join(", "))));
        }
        if fidelity == ChainFidelity::Links {
            own.error(format!("chain of `{name}` has links"), Some("set `fidelity = \"spans\"` in its table".into()));
        }
        let stiffness_n_per_m = own.number("stiffness_n_per_m", 1.0, SpanSpec::STIFFNESS_N_PER_M);
        let damping_n_s_per_m = own.number("damping_n_s_per_m", 1.0, SpanSpec::DAMPING_N_S_PER_M);
        all.push(SpanSpec { chain, name, stiffness_n_per_m, damping_n_s_per_m });
        own.finish();
    }
    table.finish();
    all
}

/// Defaults of `run.hht_alpha` and `run.tolerance_um_s`. assumed: damps what has a few steps a period, and nothing slower by much; a
/// millionth of a chain's speed.
const HHT_ALPHA: f64 = -0.1;
const TOLERANCE_M_S: f64 = 1e-5;

/// How it is run: `[run]`.
fn read_run(t: &TomlTable<'_>) -> RunSpec {
    let schemes = [("leapfrog", 0), ("hht", 1), ("predictor_corrector", 2), ("moreau", 3)];
    let scheme = match t.choice("scheme", &schemes) {
        Some(1) => Scheme::Hht { alpha: t.number("hht_alpha", 1.0, -1.0 / 3.0..=0.0).unwrap_or(HHT_ALPHA) },
        Some(2) => {
            let tolerance = t.number("tolerance_um_s", 1e-6, 1e-3..=1e5);
            Scheme::PredictorCorrector { tolerance_m_s: tolerance.unwrap_or(TOLERANCE_M_S) }
        }
        Some(3) => Scheme::Moreau { restitution: t.number("restitution", 1.0, 0.0..=1.0).unwrap_or(0.0) },
        _ => Scheme::Leapfrog,
    };
    let run = RunSpec {
        scheme,
        step_s: t.number("step_us", 1e-6, 0.001..=1000.0),
        run_in_s: t.number("run_in_ms", 1e-3, 0.0..=10_000.0).unwrap_or(25e-3),
        settle_s: t.number("settle_ms", 1e-3, 0.0..=10_000.0).unwrap_or(10e-3),
    };
    t.finish();
    run
}

/// Links and joints: `[chain]`.
fn read_links(t: &TomlTable<'_>) -> (ChainSpec, usize, ScatterSpec, JointSpec) {
    let (chain, links) = read_chain(t);
    let scatter_table = t.table("scatter");
    let scatter = ScatterSpec {
        pitch_m: scatter_table.number("pitch_um", UM, 0.0..=500.0).unwrap_or(0.0),
        seed: scatter_table.integer("seed", 0..=i64::MAX).unwrap_or(1) as u64,
    };
    scatter_table.finish();
    let joint = read_joint(&t.table("joint"));
    t.finish();
    (chain, links, scatter, joint)
}

/// The chain of the one type that is given, and its number of links.
fn read_chain(t: &TomlTable<'_>) -> (ChainSpec, usize) {
    let links = |t: &TomlTable<'_>| t.required_integer("links", 10..=2000) as usize;
    let (silent, smart) = (t.table("silent"), t.table("smartchain"));
    let bush = t.table("bush");
    let given = [bush.is_present(), silent.is_present(), smart.is_present()].iter().filter(|p| **p).count();
    if given > 1 {
        t.error("`chain` has more than one type".into(), Some("keep one of bush, silent, smartchain".into()));
    }
    if silent.is_present() {
        let result = (ChainSpec::Silent(read_silent_chain(&silent)), links(&silent));
        silent.finish();
        result
    } else if smart.is_present() {
        let result = (ChainSpec::Abutment(read_abutment_chain(&smart)), links(&smart));
        smart.finish();
        result
    } else {
        let result = (ChainSpec::Bush(read_bush_chain(&bush)), links(&bush));
        bush.finish();
        result
    }
}

fn read_silent_chain(t: &TomlTable<'_>) -> SilentChain {
    let row = |key: &str| {
        let row = t.table(key);
        let spec = SilentRowSpec {
            pin_pitch_m: row.number("pin_pitch_mm", MM, 1.0..=200.0),
            flank_pitch_m: row.number("flank_pitch_mm", MM, 1.0..=200.0),
            mass_kg: row.number("mass_g", 1e-3, 1e-3..=1e5),
            inertia_kg_m2: row.number("inertia_g_mm2", 1e-9, 1e-3..=1e9),
        };
        row.finish();
        spec
    };
    let pitch_m = t.required("pitch_mm", MM, 1.0..=200.0);
    let standard = SilentLinkForm::standard(pitch_m);
    SilentChain {
        pitch_m,
        form: SilentLinkForm {
            flank_angle_rad: t.number("flank_angle_deg", PI / 180.0, 10.0..=45.0).unwrap_or(standard.flank_angle_rad),
            face_distance_m: t.number("face_distance_mm", MM, 0.1..=100.0).unwrap_or(standard.face_distance_m),
            inside_projection_m: t
                .number("inside_projection_mm", MM, -100.0..=100.0)
                .unwrap_or(standard.inside_projection_m),
            toe_radius_m: t.number("toe_radius_mm", MM, 0.01..=100.0).unwrap_or(standard.toe_radius_m),
            crotch_radius_m: t.number("crotch_radius_mm", MM, 0.01..=100.0).unwrap_or(standard.crotch_radius_m),
        },
        pin_diameter_m: t.required("pin_diameter_mm", MM, 0.1..=150.0),
        pin_length_m: t.required("pin_length_mm", MM, 0.1..=500.0),
        pack_thickness_m: t.required("pack_thickness_mm", MM, 0.05..=200.0),
        density_kg_m3: t.number("density_kg_per_m3", 1.0, 100.0..=30_000.0).unwrap_or(7850.0),
        even: row("inner"),
        odd: row("outer"),
    }
}

fn read_abutment_chain(t: &TomlTable<'_>) -> AbutmentChain {
    let pitch = |key: &str| {
        let row = t.table(key);
        let pitch = row.number("pitch_mm", MM, 1.0..=200.0);
        row.finish();
        pitch
    };
    AbutmentChain {
        pitch_m: t.required("pitch_mm", MM, 1.0..=200.0),
        bush_diameter_m: t.required("bush_diameter_mm", MM, 0.2..=150.0),
        pin_diameter_m: t.required("pin_diameter_mm", MM, 0.1..=150.0),
        plate_height_m: t.required("plate_height_mm", MM, 0.3..=300.0),
        mass_kg: t.required("mass_g", 1e-3, 1e-3..=1e5),
        inertia_kg_m2: t.required("inertia_g_mm2", 1e-9, 1e-3..=1e9),
        abutment_distance_m: t.required("abutment_mm", MM, 0.1..=200.0),
        teeth: t.required_integer("teeth", i64::from(*TEETH_RANGE.start())..=i64::from(*TEETH_RANGE.end())) as u32,
        handover: read_handover(t),
        design_tension_n: t.required("design_tension_n", 1.0, 0.0..=1e6),
        alternate: t.choice("bushes", &[("every_link", false), ("every_other_link", true)]).unwrap_or(false),
        pitches_m: [pitch("inner"), pitch("outer")],
    }
}

fn read_handover(t: &TomlTable<'_>) -> Handover {
    if !t.choice("handover", &[("one_link", false), ("two_links", true)]).unwrap_or(false) {
        let foreign = ["rise_um", "handover_deg", "line_end_mm", "turn_0_deg", "turn_1_deg", "turn_2_deg"];
        t.only_with(&foreign, "handover = \"two_links\"");
        let given = t.number("inclination_deg", PI / 180.0, 0.0..=90.0).map(Inclination::Given);
        return Handover::OneLink(given.unwrap_or(Inclination::SmoothAcceleration));
    }
    t.only_with(&["inclination_deg"], "handover = \"one_link\"");
    let free = |key: &str| t.number(key, PI / 180.0, -90.0..=90.0).unwrap_or(0.0);
    Handover::TwoLinks(TwoLinks {
        rise_m: t.number("rise_um", 1e-6, -1e5..=1e5),
        handover_rad: t.number("handover_deg", PI / 180.0, 0.0..=90.0),
        line_end_m: t.number("line_end_mm", MM, -1000.0..=0.0),
        free_rad: ["turn_0_deg", "turn_1_deg", "turn_2_deg"].map(free),
    })
}

fn read_bush_chain(t: &TomlTable<'_>) -> BushChain {
    let row = |key: &str| {
        let row = t.table(key);
        let spec = RowSpec {
            pitch_m: row.number("pitch_mm", MM, 1.0..=200.0),
            mass_kg: row.number("mass_g", 1e-3, 1e-3..=1e5),
            inertia_kg_m2: row.number("inertia_g_mm2", 1e-9, 1e-3..=1e9),
        };
        row.finish();
        spec
    };
    BushChain {
        pitch_m: t.required("pitch_mm", MM, 1.0..=200.0),
        bush_diameter_m: t.required("bush_diameter_mm", MM, 0.2..=150.0),
        pin_diameter_m: t.required("pin_diameter_mm", MM, 0.1..=150.0),
        inner_width_m: t.required("inner_width_mm", MM, 0.1..=500.0),
        plate_height_m: t.required("plate_height_mm", MM, 0.3..=300.0),
        plate_thickness_m: t.required("plate_thickness_mm", MM, 0.05..=50.0),
        density_kg_m3: t.number("density_kg_per_m3", 1.0, 100.0..=30_000.0).unwrap_or(7850.0),
        is_cranked: t.choice("bushes", &[("every_other_link", false), ("every_link", true)]).unwrap_or(false),
        inner: row("inner"),
        outer: row("outer"),
        rollers: read_rollers(&t.table("rollers")),
    }
}

fn read_rollers(t: &TomlTable<'_>) -> Option<RollerSpec> {
    let spec = t.is_present().then(|| RollerSpec {
        diameter_m: t.required("diameter_mm", MM, 0.3..=200.0),
        clearance_m: t.required("clearance_um", UM, 0.0..=2000.0),
        mass_kg: t.number("mass_g", 1e-3, 1e-4..=1e5),
        inertia_kg_m2: t.number("inertia_g_mm2", 1e-9, 1e-4..=1e9),
        is_separate: t.choice("body", &[("link", false), ("separate", true)]).unwrap_or(true),
    });
    t.finish();
    spec
}

fn read_joint(t: &TomlTable<'_>) -> JointSpec {
    let stiffness_n_per_m = t.required("stiffness_n_per_m", 1.0, 1e3..=1e13);
    let direct = t.number("damping_n_s_per_m", 1.0, 0.0..=1e7);
    let ratio = t.number("damping_ratio", 1.0, 0.0..=10.0);
    let mode = t.number("damping_mode_hz", 1.0, 0.1..=1e6);
    let damping_n_s_per_m = match (direct, ratio, mode) {
        (Some(c), None, None) => c,
        // Stiffness-proportional: a mode at omega in which the joints are the springs has zeta = c omega / (2 k).
        (None, Some(zeta), Some(hz)) => 2.0 * zeta * stiffness_n_per_m / (2.0 * PI * hz),
        _ => {
            t.error(
                format!("the damping of `{}` is not stated in one way", t.path()),
                Some(
                    "write `damping_n_s_per_m`, or `damping_ratio` together with the `damping_mode_hz` it refers to"
                        .into(),
                ),
            );
            f64::NAN
        }
    };
    let joint = JointSpec {
        stiffness_n_per_m,
        damping_n_s_per_m,
        clearance_m: t.number("clearance_um", UM, 0.0..=1000.0).unwrap_or(0.0),
        friction: t.number("friction", 1.0, 0.0..=2.0).unwrap_or(0.0),
        stick_speed_rad_s: t.number("stick_speed_rad_s", 1.0, 1e-3..=1e5).unwrap_or(10.0),
    };
    t.finish();
    joint
}

/// Sprockets and shafts, and how the driver turns.
fn read_sprockets(
    root: &TomlTable<'_>,
    chains: &[(String, TomlTable<'_>)],
    constant_loads: &TomlTable<'_>,
) -> (Vec<SprocketDrive>, Vec<ShaftSpec>, MotionSpec) {
    let table = root.table("sprockets");
    let speeds = Speeds::new(root);
    let mut motion = MotionSpec::default();
    let shafts = read_shafts(root, &speeds, constant_loads, &mut motion);
    let owners: Vec<&TomlTable<'_>> =
        if chains.is_empty() { vec![root] } else { chains.iter().map(|(_, t)| t).collect() };
    let routes: Vec<Option<Vec<String>>> = owners.iter().map(|t| t.texts("route")).collect();
    let mut all = Vec::new();
    for (name, t) in table.tables() {
        // Keys of gaps that seat bushes, and of rings, mean nothing to other chains: unknown there.
        let own = routes.iter().position(|route| route.as_ref().is_some_and(|r| r.contains(&name))).unwrap_or(0);
        let chain = owners[own].table("chain");
        let (bushed, ringed) = (!chain.table("silent").is_present(), chain.table("smartchain").is_present());
        let (outer, shaft) = read_outer((&name, &t), &shafts, (&speeds, constant_loads), &mut motion);
        all.push(SprocketDrive {
            teeth: t.required_integer("teeth", i64::from(*TEETH_RANGE.start())..=i64::from(*TEETH_RANGE.end())) as u32,
            form: bushed
                .then(|| t.choice("gap_form", &[("min", GapForm::Min), ("max", GapForm::Max)]))
                .flatten()
                .unwrap_or(GapForm::Max),
            tip_diameter_m: t.number("tip_diameter_mm", MM, 1.0..=10_000.0),
            root_relief_m: bushed.then(|| t.number("root_relief_um", UM, 0.0..=2000.0)).flatten().unwrap_or(0.0),
            ring: ringed
                .then(|| t.choice("ring", &[("conjugate", RingForm::Conjugate), ("plain", RingForm::Plain)]))
                .flatten()
                .unwrap_or(RingForm::Conjugate),
            face: if bushed { FaceForm::Arc } else { read_face(&t) },
            root_clearance_m: (!bushed).then(|| t.number("root_clearance_mm", MM, 1e-3..=100.0)).flatten(),
            corner_radius_m: (!bushed).then(|| t.number("corner_radius_mm", MM, 1e-3..=100.0)).flatten(),
            x_m: t.number("x_mm", MM, -1e5..=1e5).unwrap_or(0.0),
            y_m: t.number("y_mm", MM, -1e5..=1e5).unwrap_or(0.0),
            wrap: t.choice("wrap", &[("inside", Wrap::Inside), ("outside", Wrap::Outside)]).unwrap_or(Wrap::Inside),
            outer,
            passes_on_nm: 0.0,
            chain: 0,
            shaft,
            name,
        });
        t.finish();
    }
    speeds.finish();
    constant_loads.finish();
    (order_by_routes(root, &owners, routes, all), shafts, motion)
}

/// What turns a sprocket: its shaft, a prescribed speed, or a load on its own inertia; and the index of its shaft.
fn read_outer(
    (name, t): (&str, &TomlTable<'_>),
    shafts: &[ShaftSpec],
    (speeds, loads): (&Speeds<'_>, &TomlTable<'_>),
    motion: &mut MotionSpec,
) -> (OuterSpec, Option<usize>) {
    let (has_speed, load) = (speeds.has(name), loads.table(name));
    let inertia = t.number("inertia_kg_m2", 1.0, 1e-9..=1e6);
    let shaft = t.text("shaft").and_then(|shaft| {
        if inertia.is_some() || has_speed || load.is_present() {
            t.error_at("shaft", format!("`{shaft}` has the inertia, the speed and the load"), None);
        }
        let known = shafts.iter().position(|s| s.name == shaft);
        if known.is_none() {
            let names: Vec<&str> = shafts.iter().map(|s| s.name.as_str()).collect();
            let help = format!("shafts: {}", names.join(", "));
            t.error_at("shaft", format!("no shaft is called `{shaft}`"), Some(help));
        }
        known
    });
    let outer = if let Some(shaft) = shaft {
        shafts[shaft].outer
    } else if has_speed {
        if load.is_present() {
            load.error(format!("`{name}` has a prescribed speed and a load"), Some("take one of them away".into()));
        }
        *motion = speeds.read(name);
        OuterSpec::Speed { speed_rad_s: motion.speeds[0].1 }
    } else {
        if inertia.is_none() {
            t.error(
                format!("`{name}` has neither a speed nor an inertia"),
                Some(format!("add `inertia_kg_m2` here, or a table `[speeds.constant.{name}]` with `speed_rpm`")),
            );
        }
        let torque_nm = load.number("torque_nm", 1.0, -1e6..=1e6).unwrap_or(0.0);
        OuterSpec::Load { inertia_kg_m2: inertia.unwrap_or(f64::NAN), torque_nm }
    };
    load.finish();
    (outer, shaft)
}

/// Shafts that several sprockets sit on: `[shafts.NAME]`.
fn read_shafts(
    root: &TomlTable<'_>,
    speeds: &Speeds<'_>,
    loads: &TomlTable<'_>,
    motion: &mut MotionSpec,
) -> Vec<ShaftSpec> {
    let table = root.table("shafts");
    let mut all = Vec::new();
    for (name, t) in table.tables() {
        let load = loads.table(&name);
        let outer = if speeds.has(&name) {
            *motion = speeds.read(&name);
            OuterSpec::Speed { speed_rad_s: motion.speeds[0].1 }
        } else {
            OuterSpec::Load {
                inertia_kg_m2: t.required("inertia_kg_m2", 1.0, 1e-9..=1e6),
                torque_nm: load.number("torque_nm", 1.0, -1e6..=1e6).unwrap_or(0.0),
            }
        };
        all.push(ShaftSpec { name, outer });
        [load, t].iter().for_each(TomlTable::finish);
    }
    table.finish();
    all
}

/// A flat face on a flat flank would touch along a length, which no point stands for: straight teeth are crowned a little.
fn read_face(t: &TomlTable<'_>) -> FaceForm {
    if t.choice("face", &[("arc", false), ("crowned", true)]).unwrap_or(false) {
        return FaceForm::Crowned {
            radius_m: t.required("face_radius_mm", MM, 0.1..=1000.0),
            contact_distance_m: t.required("contact_distance_mm", MM, 0.01..=100.0),
        };
    }
    t.only_with(&["face_radius_mm", "contact_distance_mm"], "face = \"crowned\"");
    FaceForm::Arc
}

/// Sorts the sprockets by `route`, the order in which the chain meets them, of one chain after the other.
fn order_by_routes(
    root: &TomlTable<'_>,
    chains: &[&TomlTable<'_>],
    routes: Vec<Option<Vec<String>>>,
    all: Vec<SprocketDrive>,
) -> Vec<SprocketDrive> {
    let names: Vec<String> = all.iter().map(|s| s.name.clone()).collect();
    let mut sorted = Vec::new();
    let mut whole = Vec::new();
    for (chain, (t, route)) in chains.iter().zip(routes).enumerate() {
        let route = route.unwrap_or_else(|| if chains.len() == 1 { names.clone() } else { Vec::new() });
        order_by_route(t, chain, &route, &all, &mut sorted);
        whole.extend(route);
    }
    let mut seen = whole.clone();
    seen.sort();
    seen.dedup();
    if seen.len() != whole.len() || whole.len() != names.len() {
        root.error(
            "`route` must name every sprocket once".into(),
            Some(format!("sprockets here: {}", names.join(", "))),
        );
    }
    sorted
}

fn order_by_route(
    root: &TomlTable<'_>,
    chain: usize,
    route: &[String],
    all: &[SprocketDrive],
    sorted: &mut Vec<SprocketDrive>,
) {
    let names: Vec<String> = all.iter().map(|s| s.name.clone()).collect();
    let before = sorted.len();
    for name in route {
        match all.iter().find(|s| s.name == *name) {
            Some(s) => sorted.push(SprocketDrive { chain, ..s.clone() }),
            None => root.error(
                format!("`route` names `{name}`, which is no sprocket"),
                Some(format!("sprockets here: {}", names.join(", "))),
            ),
        }
    }
    if sorted.len() - before < 2 {
        root.error(
            "a drive needs at least two sprockets in its route".into(),
            Some("add `[sprockets.NAME]` tables and `route = [...]`".into()),
        );
    }
}

/// `before`: sprockets of the chains before this one.
fn read_preload(
    t: &TomlTable<'_>,
    names: &[String],
    before: usize,
    (arms, blades): (&[ArmSpec], &[&str]),
) -> PreloadSpec {
    let arm = t.text("moves").and_then(|name| arms.iter().position(|a| a.name == name)).map(PreloadSpec::Arm);
    let blade = || t.text("moves").filter(|name| blades.contains(&name.as_str())).map(|_| PreloadSpec::Blade);
    if let Some(own) = arm.or_else(blade) {
        for key in ["tension_n", "direction_deg"] {
            if t.number(key, 1.0, f64::MIN..=f64::MAX).is_some() {
                t.error_at(key, "the tensioner's spring sets the tension".into(), Some("take it away".into()));
            }
        }
        t.finish();
        return own;
    }
    let tension_n = t.required("tension_n", 1.0, 0.0..=1e6);
    let moves = t.text("moves");
    let index = match &moves {
        None => names.len().saturating_sub(1),
        Some(name) => names.iter().position(|n| n == name).unwrap_or_else(|| {
            t.error(
                format!("`preload.moves` = \"{name}\" is no sprocket and no arm"),
                Some(format!(
                    "sprockets here: {}; arms: {}",
                    names.join(", "),
                    arms.iter().map(|a| a.name.as_str()).collect::<Vec<_>>().join(", ")
                )),
            );
            0
        }),
    };
    let direction_rad = t.number("direction_deg", PI / 180.0, -360.0..=360.0);
    let preload = PreloadSpec::Sprocket { tension_n, moves: before + index, direction_rad };
    t.finish();
    preload
}
