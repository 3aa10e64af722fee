//! What many drives have in common. Profiles are computed once for all drives that are drawn alike. Where the tightening sprocket stands is found by solving for the chain's rest again and again, half
//! of the time that assembling takes. Loads, speeds, friction and effects do not move it, so that drives which differ in these alone share it.

use crate::diag::Report;
use crate::drive::sensors::{SensorSpec, SignalSpec};
use crate::drive::{ContactSpec, Drive, Effects, OuterSpec, Scheme};
use crate::model::Profiles;
use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};

/// Loops and profiles that are remembered. assumed: a study moves few numbers of the geometry at a time, and a drive takes some kilobytes.
const MOST: usize = 64;

/// Shift of the tightening sprocket [m], and mean tension of the chain at rest over the phases of its driver [N].
type TightenedLoop = (f64, Vec<f64>);

/// Profiles and tightened loops by the drives that have them; may be used by many threads.
#[derive(Default)]
pub struct SharedParts {
    profiles: Mutex<VecDeque<(Drive, Profiles)>>,
    loops: Mutex<VecDeque<(Drive, TightenedLoop)>>,
}

impl SharedParts {
    /// What a loop depends on: the drive of one chain without what does not move it. Loads and speeds keep their signs, which say on which
    /// side of a gap a bush lies.
    pub(super) fn key(drive: &Drive) -> Drive {
        let still = |c: ContactSpec| ContactSpec { friction: 0.0, stick_speed_m_s: 1.0, ..c };
        let mut key = drive.clone();
        key.name = String::new();
        key.text = String::new();
        key.title = String::new();
        key.source = String::new();
        key.overrides = Vec::new();
        key.places = crate::drive::reader::Places::empty();
        key.document = std::sync::Arc::default();
        key.effects = Effects::default();
        key.sensors = Vec::<SensorSpec>::new();
        key.signals = Vec::<SignalSpec>::new();
        // How shafts turn and what loads them, but for signs below, is added when the loop stands.
        key.train = crate::drive::shafts::ShaftTrain::default();
        key.run = crate::drive::RunSpec { scheme: Scheme::Leapfrog, step_s: None, run_in_s: 0.0, settle_s: 0.0 };
        (key.joint.friction, key.joint.stick_speed_rad_s, key.joint.damping_n_s_per_m) = (0.0, 1.0, 0.0);
        (key.tooth_contact, key.guide_contact, key.ring_contact) =
            (still(key.tooth_contact), still(key.guide_contact), still(key.ring_contact));
        let loads: f64 = key.sprockets.iter().map(|s| load_nm(s.outer) + s.passes_on_nm).sum();
        for s in &mut key.sprockets {
            let own_nm = load_nm(s.outer) + s.passes_on_nm;
            s.outer = match s.outer {
                OuterSpec::Speed { speed_rad_s } => OuterSpec::Speed { speed_rad_s: speed_rad_s.signum() },
                OuterSpec::Load { inertia_kg_m2, .. } => OuterSpec::Load { inertia_kg_m2, torque_nm: sign(own_nm) },
            };
            s.passes_on_nm = sign(loads);
        }
        key
    }

    /// Profiles of a drive, computed if no other drive has had them.
    ///
    /// # Errors
    /// A part cannot be made.
    pub(super) fn profiles(&self, drive: &Drive) -> Result<Profiles, Report> {
        let known = || self.profiles.lock().unwrap_or_else(PoisonError::into_inner);
        let own = known().iter().find(|(other, _)| Profiles::are_shared(drive, other)).map(|(_, own)| own.clone());
        if let Some(own) = own {
            return Ok(own);
        }
        // Outside the lock: others need not wait, and two that compute the same get the same bits.
        let own = Profiles::new(drive)?;
        remember(&mut known(), SharedParts::key(drive), own.clone());
        Ok(own)
    }

    pub(super) fn tightened(&self, key: &Drive) -> Option<TightenedLoop> {
        let known = self.loops.lock().unwrap_or_else(PoisonError::into_inner);
        known.iter().find(|(drive, _)| drive == key).map(|(_, own)| own.clone())
    }

    pub(super) fn keep_tightened(&self, key: Drive, own: TightenedLoop) {
        remember(&mut self.loops.lock().unwrap_or_else(PoisonError::into_inner), key, own);
    }
}

/// Adds an entry unless its key is there; the oldest one goes where there are too many.
fn remember<T>(known: &mut VecDeque<(Drive, T)>, key: Drive, own: T) {
    if known.iter().all(|(drive, _)| *drive != key) {
        known.push_front((key, own));
        known.truncate(MOST);
    }
}

fn load_nm(outer: OuterSpec) -> f64 {
    match outer {
        OuterSpec::Speed { .. } => 0.0,
        OuterSpec::Load { torque_nm, .. } => torque_nm,
    }
}

/// -1, 0 or 1.
fn sign(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.signum() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drive::BUNDLED;

    /// What does not move a loop leaves its key as it is; what moves it does not.
    #[test]
    fn keys_are_alike_where_loops_are() {
        for name in ["bush-20-40", "silent-20-40", "smartchain-20-40"] {
            let (_, text) = BUNDLED.iter().find(|b| b.0 == name).expect("bundled");
            let key = |set: &str| {
                let set: Vec<String> = set.split_whitespace().map(str::to_string).collect();
                SharedParts::key(&Drive::parse(name, text, &set).expect("a drive").single_chain(0))
            };
            let own = key("");
            for set in [
                "chain.joint.friction=0.07",
                "contact.guide.friction=0.02 contact.sprocket.friction=0.15",
                "loads.constant.driven.torque_nm=12.5",
                "speeds.constant.driver.speed_rpm=2200",
                "effects.pitch_error.a.link=3 effects.pitch_error.a.length_um=20",
                "source=elsewhere",
            ] {
                assert!(key(set) == own, "{name}: {set}");
            }
            for set in
                ["preload.tension_n=301", "loads.constant.driven.torque_nm=-5", "chain.joint.stiffness_n_per_m=2e7"]
            {
                assert!(key(set) != own, "{name}: {set}");
            }
        }
    }
}
