//! Reading contact laws: `[contact]`.

use super::reader::TomlTable;
use super::{ChainSpec, ContactSpec};
use crate::elements::contact_law::{
    ContactLaw, HertzLine, WinklerFoundation, lankarani_nikravesh_hysteresis, restitution_hysteresis,
};
use crate::units::MM;

/// Which guides a drive has.
#[derive(Clone, Copy)]
pub(super) struct GuideTables {
    pub(super) has_any: bool,
    pub(super) has_rails: bool,
}

/// Contacts with sprockets, guides and rings: `[contact]`. Where there are no guides, what touches them may be left out.
pub(super) fn read_contacts(
    t: &TomlTable<'_>,
    chain: &ChainSpec,
    guides: GuideTables,
) -> ([ContactSpec; 3], Option<ContactSpec>) {
    let width_m = match chain {
        ChainSpec::Bush(c) => c.inner_width_m,
        ChainSpec::Silent(c) => c.pack_thickness_m,
        ChainSpec::Abutment(_) => DEFAULT_CONTACT_LENGTH_M,
    };
    let tooth = read_contact(&t.table("sprocket"), width_m);
    let guide = t.table("guide");
    if guides.has_rails && guide.table("winkler").is_present() {
        let help = "take the law `linear` or `hunt_crossley`";
        guide
            .table("winkler")
            .error("a layer under plates is that of straight guides, and there are rails".into(), Some(help.into()));
    }
    let guide = if guides.has_any || guide.is_present() {
        match chain {
            ChainSpec::Bush(c) => under_plates(read_contact(&guide, width_m), c.pitch_m),
            ChainSpec::Silent(c) => under_plates(read_contact(&guide, width_m), c.pitch_m),
            ChainSpec::Abutment(_) => read_contact(&guide, width_m),
        }
    } else {
        tooth
    };
    let ring = match chain {
        ChainSpec::Abutment(_) => read_contact(&t.table("ring"), width_m),
        ChainSpec::Bush(_) | ChainSpec::Silent(_) => tooth,
    };
    let rollers = if let ChainSpec::Bush(c) = chain { c.rollers } else { None };
    let table = t.table("roller");
    // Rollers that are parts of links do not touch their bushes: what is written of that waits for them to be bodies again.
    let needs_law = rollers.is_some_and(|r| r.is_separate);
    if needs_law && !table.is_present() {
        let help = "add e.g. `[contact.roller.linear]` with stiffness_n_per_m and damping_n_s_per_m";
        t.error("rollers that are bodies of their own touch their bushes by the law in `[contact.roller]`, which is missing".into(), Some(help.into()));
    }
    let is_read = rollers.is_some() && table.is_present();
    let roller = is_read.then(|| read_contact(&table, width_m));
    t.finish();
    ([tooth, guide, ring], roller)
}

/// Length of Hertz contacts of abutment chains where none is given [m]. assumed: bush width of automotive 8 mm chains.
pub(super) const DEFAULT_CONTACT_LENGTH_M: f64 = 5.0 * MM;

/// One table of `[contact]`: the law, friction and its stick speed.
pub(super) fn read_contact(t: &TomlTable<'_>, default_length_m: f64) -> ContactSpec {
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
    let winkler = t.table("winkler");
    if winkler.is_present() {
        laws.push(ContactLaw::Winkler(read_winkler(&winkler, default_length_m)));
        winkler.finish();
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
                "add one of the tables linear, hunt_crossley, hertz_line, winkler, lankarani_nikravesh, restitution below it"
                    .into(),
            ),
        );
    }
    t.finish();
    spec
}

/// An elastic layer on a rigid ground.
fn read_winkler(t: &TomlTable<'_>, default_length_m: f64) -> WinklerFoundation {
    let e = t.required("youngs_modulus_gpa", 1e9, 1e-4..=2000.0);
    let nu = t.number("poisson_ratio", 1.0, 0.0..=0.49).unwrap_or(0.3);
    let thickness_m = t.required("thickness_mm", MM, 1e-3..=1e3);
    let length_m = t.number("length_mm", MM, 0.1..=1000.0).unwrap_or(default_length_m);
    let restitution = t.required("restitution", 1.0, 0.01..=1.0);
    let speed_m_s = t.required("restitution_at_m_s", 1.0, 1e-3..=1e3);
    let damping_s_per_m =
        if restitution.is_finite() { restitution_hysteresis(restitution) / speed_m_s } else { f64::NAN };
    let stiffness_n_per_m2 = length_m * WinklerFoundation::modulus_n_per_m3(e, nu, thickness_m);
    WinklerFoundation { stiffness_n_per_m2, damping_s_per_m }
}

/// The law of plates that lie with their straight edges on the layer of a straight guide: each end gets the pressure under half of its plate.
fn under_plates(contact: ContactSpec, pitch_m: f64) -> ContactSpec {
    let law = match contact.law {
        ContactLaw::Winkler(layer) => ContactLaw::HuntCrossley {
            stiffness_n_per_m_n: 0.5 * layer.stiffness_n_per_m2 * pitch_m,
            exponent: 1.0,
            damping_s_per_m: layer.damping_s_per_m,
        },
        ContactLaw::Linear { .. }
        | ContactLaw::HertzLine(_)
        | ContactLaw::HuntCrossley { .. }
        | ContactLaw::Power { .. } => contact.law,
    };
    ContactSpec { law, ..contact }
}
