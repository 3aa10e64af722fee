//! Reading a drive file, table by table: which keys there are, their units and ranges. A key that nothing here asks for is
//! unknown.

use super::bearings::{self, CarriedNames};
use super::reader::{Places, TomlTable};
use super::shafts::{self, MotionSpec, MovingNames, ShaftTrain, Speeds};
use super::{
    ArmSpec, ChainFidelity, ChainPart, ChainSpec, ContactSpec, Drive, FaceForm, GuideSpec, JointSpec, OuterSpec,
    PreloadSpec, RailSpec, RingForm, RunSpec, ScatterSpec, ShaftSpec, SprocketDrive,
};
use super::{effects, mechanism, sensors};
use crate::elements::beam::{Beam, MAX_MODES, Support};
use crate::elements::contact_law::{ContactLaw, HertzLine, lankarani_nikravesh_hysteresis, restitution_hysteresis};
use crate::geometry::Vec2;
use crate::geometry::chain::abutment::{AbutmentChain, Handover};
use crate::geometry::chain::bush::{BushChain, RollerSpec, RowSpec};
use crate::geometry::chain::silent::{SilentChain, SilentLinkForm, SilentRowSpec};
use crate::geometry::guide::GuideSide;
use crate::geometry::rail::Stretch;
use crate::geometry::route::Wrap;
use crate::geometry::smartchain::{Inclination, TwoLinks};
use crate::geometry::sprocket::{GapForm, TEETH_RANGE};
use crate::units::{DEG, MM, UM};
use std::f64::consts::PI;
use std::sync::Arc;

/// Reads everything; mistakes are kept by the reader and the returned values are then of no use.
pub(super) fn drive(root: &TomlTable<'_>) -> Drive {
    let title = root.text("title").unwrap_or_default();
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
    let fidelity = chains.first().map_or(ChainFidelity::Links, |(_, t)| read_fidelity(t));
    let contacts = first.table("contact");
    let (stop_table, tip_table) = (contacts.table("stop"), contacts.table("tip"));
    let ([tooth_contact, guide_contact, ring_contact], roller_contact) = read_contacts(&first.table("contact"), &chain);
    let read = |t: &TomlTable<'_>| read_contact(t, DEFAULT_CONTACT_LENGTH_M);
    let arms = mechanism::read_arms(root, &names);
    let stop_contact = mechanism::read_stops(&stop_table, &arms, read);
    let sliders = mechanism::read_sliders(root, &names, &arms);
    let tip_contact = mechanism::read_tips(&tip_table, &sliders, read);
    let oil = mechanism::read_oil(root, &sliders);
    let moving = MovingNames { sprockets: &sprockets, shafts: &shafts, arms: &arms, sliders: &sliders };
    let mut train = ShaftTrain { motion, couplings: shafts::read_couplings(root, &moving), ..ShaftTrain::default() };
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
    let preload = read_preload(&first.table("preload"), &own(0), 0, (&arms, &blades(0)));
    let mut more = Vec::new();
    for (index, (_, t)) in chains.iter().enumerate().skip(1) {
        let (chain, links, scatter, joint) = read_links(&t.table("chain"));
        let ([tooth_contact, guide_contact, ring_contact], roller_contact) = read_contacts(&t.table("contact"), &chain);
        let before = (0..index).map(|c| own(c).len()).sum();
        let preload = read_preload(&t.table("preload"), &own(index), before, (&arms, &blades(index)));
        let fidelity = read_fidelity(t);
        more.push(ChainPart {
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
        });
    }
    chains.iter().for_each(|(_, t)| t.finish());
    let chain_names = chains.iter().map(|(name, _)| name.clone()).collect();
    several.finish();
    let driver = sprockets.iter().find(|s| matches!(s.outer, OuterSpec::Speed { .. })).map(|s| s.name.clone());
    let parts = mechanism::parts(&sliders, oil.as_ref());
    // In the order of the bodies: guides, then rails.
    let guide_names: Vec<&str> =
        guides.iter().map(|g| g.name.as_str()).chain(rails.iter().map(|r| r.name.as_str())).collect();
    let turning = shafts::turning_names(&sprockets, &shafts, &arms);
    let targets = sensors::SensorTargets {
        spans: &spans,
        turning: &turning,
        driver: driver.as_deref(),
        guides: &guide_names,
        parts: &parts,
    };
    let sensors = sensors::sensors(root, targets);
    let (effects, signals) = effects::read_effects(&effect_table, &names, &guides, &sensors);
    let run = read_run(&root.table("run"));
    root.finish();
    let (places, document) = (Places::empty(), Arc::default());
    let (name, text, overrides) = (String::new(), String::new(), Vec::new());
    Drive {
        name,
        text,
        overrides,
        title,
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
        shafts,
        bearings,
        train,
        sprockets,
        guides,
        arms,
        sliders,
        tip_contact,
        oil,
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

/// What a chain of several is made of.
fn read_fidelity(t: &TomlTable<'_>) -> ChainFidelity {
    let kinds = [("links", ChainFidelity::Links), ("spans", ChainFidelity::Spans)];
    t.choice("fidelity", &kinds).unwrap_or(ChainFidelity::Links)
}

/// How it is run: `[run]`.
fn read_run(t: &TomlTable<'_>) -> RunSpec {
    let run = RunSpec {
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

/// Contacts with sprockets, guides and rings: `[contact]`.
fn read_contacts(t: &TomlTable<'_>, chain: &ChainSpec) -> ([ContactSpec; 3], Option<ContactSpec>) {
    let width_m = match chain {
        ChainSpec::Bush(c) => c.inner_width_m,
        ChainSpec::Silent(c) => c.pack_thickness_m,
        ChainSpec::Abutment(_) => DEFAULT_CONTACT_LENGTH_M,
    };
    let tooth = read_contact(&t.table("sprocket"), width_m);
    let guide = read_contact(&t.table("guide"), width_m);
    let ring = match chain {
        ChainSpec::Abutment(_) => read_contact(&t.table("ring"), width_m),
        ChainSpec::Bush(_) | ChainSpec::Silent(_) => tooth,
    };
    let rollers = if let ChainSpec::Bush(c) = chain { c.rollers } else { None };
    let table = t.table("roller");
    // Rollers that are parts of links do not touch their bushes: what is written of that waits for them to be bodies again.
    let is_read = rollers.is_some_and(|r| r.is_separate || table.is_present());
    let roller = is_read.then(|| read_contact(&table, width_m));
    t.finish();
    ([tooth, guide, ring], roller)
}

/// Length of Hertz contacts of abutment chains where none is given [m]. assumed: bush width of automotive 8 mm chains.
const DEFAULT_CONTACT_LENGTH_M: f64 = 5.0 * MM;

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

fn read_contact(t: &TomlTable<'_>, default_length_m: f64) -> ContactSpec {
    let mut laws = Vec::new();
    let linear = t.table("linear");
    if linear.is_present() {
        laws.push(ContactLaw::Linear {
            stiffness_n_per_m: linear.required("stiffness_n_per_m", 1.0, 1e2..=1e13),
            damping_n_s_per_m: linear.number("damping_n_s_per_m", 1.0, 0.0..=1e7).unwrap_or(0.0),
        });
        linear.finish();
    }
    let law = t.table("hunt_crossley");
    if law.is_present() {
        let e = law.required("restitution", 1.0, 0.01..=1.0);
        let speed_m_s = law.required("restitution_at_m_s", 1.0, 1e-3..=1e3);
        let exponent = law.number("exponent", 1.0, 1.0..=3.0).unwrap_or(1.0);
        let (key, most) = if exponent == 1.0 { ("stiffness_n_per_m", 1e13) } else { ("stiffness_n_per_m_n", 1e16) };
        laws.push(ContactLaw::HuntCrossley {
            stiffness_n_per_m_n: law.required(key, 1.0, 1e2..=most),
            exponent,
            damping_s_per_m: if e.is_finite() { restitution_hysteresis(e) / speed_m_s } else { f64::NAN },
        });
        law.finish();
    }
    let hertz = t.table("hertz_line");
    if hertz.is_present() {
        let compliance = |t: &TomlTable<'_>, which: &str| {
            let e = t.required(&format!("{which}_youngs_modulus_gpa"), 1e9, 1e-3..=2000.0);
            let nu = t.number(&format!("{which}_poisson_ratio"), 1.0, 0.0..=0.499).unwrap_or(0.3);
            (1.0 - nu * nu) / e
        };
        laws.push(ContactLaw::HertzLine(HertzLine {
            length_m: hertz.number("length_mm", MM, 0.1..=1000.0).unwrap_or(default_length_m),
            compliance_body_per_pa: compliance(&hertz, "body"),
            compliance_bush_per_pa: compliance(&hertz, "chain"),
            damping_n_s_per_m: hertz.number("damping_n_s_per_m", 1.0, 0.0..=1e7).unwrap_or(0.0),
        }));
        hertz.finish();
    }
    for (key, hysteresis) in [
        ("lankarani_nikravesh", lankarani_nikravesh_hysteresis as fn(f64) -> f64),
        ("restitution", restitution_hysteresis as fn(f64) -> f64),
    ] {
        let law = t.table(key);
        if law.is_present() {
            let e = law.required("restitution", 1.0, 0.01..=1.0);
            laws.push(ContactLaw::Power {
                stiffness_n_per_m_n: law.required("stiffness_n_per_m_n", 1.0, 1e2..=1e16),
                exponent: law.number("exponent", 1.0, 1.0..=3.0).unwrap_or(1.5),
                hysteresis: if e.is_finite() { hysteresis(e) } else { f64::NAN },
            });
            law.finish();
        }
    }
    let spec = ContactSpec {
        law: laws
            .first()
            .copied()
            .unwrap_or(ContactLaw::Linear { stiffness_n_per_m: f64::NAN, damping_n_s_per_m: 0.0 }),
        friction: t.number("friction", 1.0, 0.0..=2.0).unwrap_or(0.0),
        stick_speed_m_s: t.number("stick_speed_m_s", 1.0, 1e-6..=100.0).unwrap_or(0.05),
    };
    if laws.len() != 1 {
        t.error(
            format!("`{}` has {} contact laws, it needs one", t.path(), laws.len()),
            Some(
                "add one of the tables linear, hunt_crossley, hertz_line, lankarani_nikravesh, restitution below it"
                    .into(),
            ),
        );
    }
    t.finish();
    spec
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

/// The sprocket that the way of `span = ["a", "b"]` leaves.
fn read_span(t: &TomlTable<'_>, chains: &[Vec<String>]) -> usize {
    let span = t.texts("span").unwrap_or_default();
    let mut before = 0;
    let mut spans = Vec::new();
    for names in chains {
        let pairs = (0..names.len()).map(|i| (i, &names[i], &names[(i + 1) % names.len()]));
        for (i, from, to) in pairs {
            if let [a, b] = &span[..]
                && (a, b) == (from, to)
            {
                return before + i;
            }
            spans.push(format!("[\"{from}\", \"{to}\"]"));
        }
        before += names.len();
    }
    t.error(format!("`{}.span` is no span of the route", t.path()), Some(format!("spans here: {}", spans.join(", "))));
    0
}

const SIDES: [(&str, GuideSide); 2] = [("inside", GuideSide::Inside), ("outside", GuideSide::Outside)];

/// `all_names`: those of sprockets and fixed guides.
fn read_rails(guides: &TomlTable<'_>, chains: &[Vec<String>], arms: &[ArmSpec], all_names: &[String]) -> Vec<RailSpec> {
    let table = guides.table("rail");
    let mut all = Vec::new();
    for (name, t) in table.tables() {
        if all_names.contains(&name) {
            t.error(format!("a rail and another body are called `{name}`"), Some("give the rail another name".into()));
        }
        let known = || arms.iter().map(|a| a.name.as_str()).collect::<Vec<_>>().join(", ");
        let arm = t.text("arm").map(|arm| {
            arms.iter().position(|a| a.name == arm).unwrap_or_else(|| {
                t.error_at("arm", format!("no arm is called `{arm}`"), Some(format!("arms: {}", known())));
                0
            })
        });
        let lengths_m = t.list("lengths_mm", MM, 1e-3..=1e5);
        if !t.has("lengths_mm") {
            t.error(
                format!("`{}` has no stretches", t.path()),
                Some("add `lengths_mm = [...]`, and as many `radii_mm` (0: straight, negative: concave)".into()),
            );
        }
        let lengths_m = lengths_m.unwrap_or_default();
        let radii_m = t.list("radii_mm", MM, -1e6..=1e6).unwrap_or_else(|| vec![0.0; lengths_m.len()]);
        if radii_m.len() != lengths_m.len() && !lengths_m.is_empty() {
            t.error_at("radii_mm", format!("{} lengths, {} radii", lengths_m.len(), radii_m.len()), None);
        }
        let stretch =
            |(length_m, r): (&f64, &f64)| Stretch { length_m: *length_m, radius_m: (*r != 0.0).then_some(*r) };
        all.push(RailSpec {
            span: read_span(&t, chains),
            arm,
            side: t.choice("side", &SIDES).unwrap_or(GuideSide::Inside),
            start: Vec2::new(t.required("start_x_mm", MM, -1e5..=1e5), t.required("start_y_mm", MM, -1e5..=1e5)),
            heading_rad: t.required("heading_deg", DEG, -360.0..=360.0),
            stretches: lengths_m.iter().zip(&radii_m).map(stretch).collect(),
            bending: read_bending(&t.table("bending"), arm.is_some(), &lengths_m),
            name,
        });
        t.finish();
    }
    table.finish();
    all
}

/// `[guides.rail.NAME.bending]`; None where there is none.
fn read_bending(t: &TomlTable<'_>, on_arm: bool, lengths_m: &[f64]) -> Option<Beam> {
    if !t.is_present() {
        return None;
    }
    if on_arm {
        t.error("a rail on an arm is rigid yet".into(), Some("hold the blade by pins, clamps or springs".into()));
    }
    let places = |key: &str| t.list(key, MM, 0.0..=1e5).unwrap_or_default();
    let (pins, clamps, springs) = (places("pins_mm"), places("clamps_mm"), places("springs_mm"));
    let stiffnesses = t.list("springs_n_per_mm", 1e3, 1e-3..=1e6).unwrap_or_default();
    if stiffnesses.len() != springs.len() {
        let counts = format!("{} springs_mm, {} springs_n_per_mm", springs.len(), stiffnesses.len());
        t.error(counts, Some("give as many of each".into()));
    }
    let mut supports: Vec<(f64, Support)> = pins.into_iter().map(|at| (at, Support::Pin)).collect();
    supports.extend(clamps.into_iter().map(|at| (at, Support::Clamp)));
    supports.extend(springs.into_iter().zip(stiffnesses).map(|(at, k)| (at, Support::Spring(k))));
    let length_m: f64 = lengths_m.iter().sum();
    if let Some((at, _)) = supports.iter().find(|(at, _)| *at > length_m * (1.0 + 1e-9)) {
        t.error(format!("a support at {:.3} mm of a rail {:.3} mm long", at / MM, length_m / MM), None);
    }
    supports.sort_by(|a, b| a.0.total_cmp(&b.0));
    if supports.windows(2).any(|s| s[1].0 - s[0].0 < CLOSEST_SUPPORTS * length_m) {
        t.error("two supports stand at one place".into(), Some("keep one of them".into()));
    }
    if supports.iter().map(|(_, s)| s.holds()).sum::<usize>() < 2 {
        t.error("nothing holds the blade".into(), Some("give two `pins_mm`, or one of `clamps_mm`".into()));
    }
    let free_radii_m = t.list("free_radii_mm", MM, -1e6..=1e6);
    if let Some(all) = &free_radii_m {
        if all.iter().any(|r| *r != 0.0 && r.abs() < SMALLEST_FREE_RADIUS_M) {
            let help = format!("0 is straight; else at least {} mm", SMALLEST_FREE_RADIUS_M / MM);
            t.error_at("free_radii_mm", "a blade is not bent so much".into(), Some(help));
        }
        if all.len() != lengths_m.len() {
            let title = format!("a rail of {} stretches", lengths_m.len());
            t.error_at("free_radii_mm", title, Some("give as many".into()));
        }
    }
    let curvature = |r: f64| if r == 0.0 { 0.0 } else { 1.0 / r };
    let bending = Beam {
        stiffness_n_m2: t.required("stiffness_n_m2", 1.0, 1e-6..=1e6),
        mass_kg_per_m: t.required("mass_kg_per_m", 1.0, 1e-4..=1e3),
        free_curvatures_per_m: free_radii_m.map(|all| all.into_iter().map(curvature).collect()),
        supports,
        damping_ratio: t.number("damping_ratio", 1.0, 0.0..=1.0).unwrap_or(DEFAULT_BLADE_DAMPING),
        modes: t.integer("modes", 1..=MAX_MODES as i64).unwrap_or(DEFAULT_MODES) as usize,
    };
    t.finish();
    Some(bending)
}

/// Least distance of two supports, as a share of the blade's length.
const CLOSEST_SUPPORTS: f64 = 1e-3;
/// Least radius of a blade without load [m].
const SMALLEST_FREE_RADIUS_M: f64 = 1e-3;
/// Damping ratio of a blade where none is given. assumed: PA66 at 100 degrees Celsius has a loss factor of 0.05 to 0.1.
const DEFAULT_BLADE_DAMPING: f64 = 0.03;
/// Modes of a blade where no number is given: with four, a cantilever's tip is soft to 0.1 %.
const DEFAULT_MODES: i64 = 4;

fn read_guides(guides: &TomlTable<'_>, chains: &[Vec<String>]) -> Vec<GuideSpec> {
    let fixed = guides.table("fixed");
    let mut all = Vec::new();
    for (name, t) in fixed.tables() {
        all.push(GuideSpec {
            span: read_span(&t, chains),
            side: t.choice("side", &SIDES).unwrap_or(GuideSide::Inside),
            start_m: t.required("start_mm", MM, -1000.0..=1e5),
            end_m: t.required("end_mm", MM, -1000.0..=1e5),
            clearance_m: t.number("clearance_um", UM, -1e5..=1e6).unwrap_or(0.0),
            end_lift_m: t.number("end_lift_um", UM, -5000.0..=5000.0).unwrap_or(0.0),
            end_radius_m: t.number("end_radius_mm", MM, 0.1..=1e4).unwrap_or(20.0 * MM),
            name,
        });
        t.finish();
    }
    fixed.finish();
    all
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
