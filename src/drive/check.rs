//! Checks of a drive that need more than one value. Every mistake of a file is found in one pass, and points at its place.

use super::bearings::Carried;
use super::reader::Places;
use super::sensors::SensorReads;
use super::{ChainFidelity, ChainSpec, Drive, LARGEST_PITCH_ERROR, OuterSpec, PreloadSpec, RingForm, SprocketDrive};
use crate::diag::{Diag, Report};
use crate::effects::{Effect, gap_error, link_mass, pitch_error, sprocket_runout, tight_joint, tooth_pitch_error};
use crate::elements::contact_law::ContactLaw;
use crate::geometry::guide::GuideSide;
use crate::geometry::rail::Rail;
use crate::geometry::route::Wrap;

/// What is wrong with a drive.
struct DriveErrors<'a> {
    places: &'a Places,
    found: Vec<Diag>,
}

/// The table of a law whose force depends on the radii of both parts.
fn needs_radius(law: &ContactLaw) -> Option<&'static str> {
    match law {
        ContactLaw::HertzLine(_) => Some("hertz_line"),
        ContactLaw::Winkler(_) => Some("winkler"),
        ContactLaw::Linear { .. } | ContactLaw::HuntCrossley { .. } | ContactLaw::Power { .. } => None,
    }
}

impl<'a> DriveErrors<'a> {
    fn new(drive: &'a Drive) -> DriveErrors<'a> {
        DriveErrors { places: &drive.places, found: Vec::new() }
    }

    fn add(&mut self, path: &str, title: String, help: &str) {
        self.found.push(self.places.error(path, title, Some(help.to_string())));
    }

    fn report(self) -> Result<(), Report> {
        if self.found.is_empty() { Ok(()) } else { Err(self.places.report(self.found)) }
    }
}

impl Drive {
    /// Checks of how several chains hang together.
    pub(super) fn check_chains(&self) -> Result<(), Report> {
        if self.more.is_empty() {
            return Ok(());
        }
        let mut mistakes = DriveErrors::new(self);
        for chain in 0..self.chains() {
            self.check_place(chain, &mut mistakes);
        }
        self.check_spans(&mut mistakes);
        self.check_numbers(&mut mistakes);
        self.check_shafts(&mut mistakes);
        mistakes.report()
    }

    /// How a chain of several is driven, tightened and guided.
    fn check_place(&self, chain: usize, mistakes: &mut DriveErrors<'_>) {
        let name = &self.chain_names[chain];
        let own = self.sprockets_of(chain);
        let leader = self.leader_of(chain);
        let before =
            |s: &SprocketDrive| s.chain < chain && s.shaft.is_some() && s.shaft == self.sprockets[leader].shaft;
        let driven =
            matches!(self.sprockets[leader].outer, OuterSpec::Speed { .. }) || self.sprockets.iter().any(before);
        if !driven {
            mistakes.add(
                &format!("chains.{name}.route"),
                format!("nothing turns chain `{name}`"),
                "put one of its sprockets on a `shaft` that a chain before it turns, or give one a speed; chains stand in the \
                 order in which they drive each other",
            );
        }
        if let PreloadSpec::Sprocket { moves, .. } = *self.preload_of(chain)
            && self.sprockets.iter().filter(|s| s.shaft.is_some() && s.shaft == self.sprockets[moves].shaft).count() > 1
        {
            mistakes.add(
                &format!("chains.{name}.preload.moves"),
                format!("sprocket `{}` shares its shaft with another chain's", self.sprockets[moves].name),
                "tighten the chain by a sprocket of its own, or by an arm",
            );
        }
        for r in self.rails.iter().filter(|r| own.contains(&r.span)) {
            if let Some(arm) = r.arm
                && self.rails.iter().any(|o| o.arm == Some(arm) && !own.contains(&o.span))
            {
                mistakes.add(
                    &format!("guides.rail.{}.arm", r.name),
                    format!("arm `{}` carries rails of two chains", self.arms[arm].name),
                    "give each chain an arm of its own",
                );
            }
        }
    }

    /// Chains of spans, and what only links can do.
    fn check_spans(&self, mistakes: &mut DriveErrors<'_>) {
        let with_spans = |chain: usize| self.fidelity_of(chain) == ChainFidelity::Spans;
        if (0..self.chains()).all(with_spans) {
            mistakes.add(
                &format!("chains.{}.fidelity", self.chain_names[0]),
                "no chain of this drive has links".into(),
                "leave one with `fidelity = \"links\"`; a drive without any is a lumped drive (`pitchline lump`)",
            );
        }
        for chain in (0..self.chains()).filter(|chain| with_spans(*chain)) {
            let (name, own) = (&self.chain_names[chain], self.sprockets_of(chain));
            let links = format!("chain `{name}` has spans in place of links");
            let help = format!("take it away, or set `chains.{name}.fidelity = \"links\"`");
            for g in self.guides.iter().filter(|g| own.contains(&g.span)) {
                let path = format!("guides.fixed.{}", g.name);
                mistakes.add(&path, format!("guide `{}` guides links, and {links}", g.name), &help);
            }
            for r in self.rails.iter().filter(|r| own.contains(&r.span)) {
                let path = format!("guides.rail.{}", r.name);
                mistakes.add(&path, format!("rail `{}` guides links, and {links}", r.name), &help);
            }
            for b in self.bearings.iter().filter(|b| own.clone().any(|k| self.is_on_bearing(b, k))) {
                mistakes.add(&b.path, format!("this bearing yields to links, and {links}"), &help);
            }
            let named = |s: usize| own.contains(&s);
            for e in self.effects.gap_errors.iter().filter(|e| named(e.sprocket)) {
                let path = gap_error::ROW.path(&self.sprockets[e.sprocket].name, "gap");
                mistakes.add(&path, format!("gaps seat links, and {links}"), &help);
            }
            for w in self.effects.gap_waves.iter().filter(|w| named(w.sprocket)) {
                let effect = if w.order.is_some() { &tooth_pitch_error::ROW } else { &sprocket_runout::ROW };
                let path = format!("effects.{}.{}", effect.name, self.sprockets[w.sprocket].name);
                mistakes.add(&path, format!("gaps seat links, and {links}"), &help);
            }
            if !matches!(self.preload_of(chain), PreloadSpec::Sprocket { .. }) {
                let title = format!("an arm or a blade presses on links, and {links}");
                mistakes.add(&format!("chains.{name}.preload.moves"), title, "name a sprocket, and give `tension_n`");
            }
            let turned = |s: &&SprocketDrive| {
                s.shaft.is_some() && self.sprockets[..own.start].iter().any(|o| o.shaft == s.shaft)
            };
            if self.sprockets[own.clone()].iter().filter(turned).count() > 1 {
                mistakes.add(
                    &format!("chains.{name}.route"),
                    format!("chains before `{name}` turn two of its shafts"),
                    "a chain of spans joins one turned shaft with shafts that nothing else turns",
                );
            }
        }
    }

    /// Links, joints and arms that effects and sensors name by their numbers through all chains.
    fn check_numbers(&self, mistakes: &mut DriveErrors<'_>) {
        let links: usize = (0..self.chains()).map(|c| self.link_bodies_of(c)).sum();
        let help =
            format!("links and joints are numbered 0 to {} through all chains with links", links.saturating_sub(1));
        for (effect, name, link) in self.link_effects().filter(|(_, _, link)| *link >= links) {
            mistakes.add(&effect.path(name, "link"), format!("the chains have no link {link}"), &help);
        }
        for e in self.effects.tight_joints.iter().filter(|e| e.joint >= links) {
            let path = tight_joint::ROW.path(&e.name, "joint");
            mistakes.add(&path, format!("the chains have no joint {}", e.joint), &help);
        }
        for s in &self.sensors {
            if let SensorReads::Link(link) = s.reads
                && link >= links
            {
                mistakes.add(&format!("{}.link", s.path), format!("the chains have no link {link}"), &help);
            }
        }
        for (a, arm) in self.arms.iter().enumerate() {
            if !self.rails.iter().any(|r| r.arm == Some(a)) {
                let path = format!("arms.{}", arm.name);
                mistakes.add(&path, format!("arm `{}` carries no rail", arm.name), "give a rail this `arm`");
            }
        }
    }

    /// Shafts and what prescribes a speed.
    fn check_shafts(&self, mistakes: &mut DriveErrors<'_>) {
        let speeds = |of: &dyn Fn(&SprocketDrive) -> bool| {
            self.sprockets.iter().filter(|s| of(s) && matches!(s.outer, OuterSpec::Speed { .. })).count()
        };
        let on_shafts = (0..self.shafts.len()).filter(|k| speeds(&|s| s.shaft == Some(*k)) > 0).count();
        let drivers = speeds(&|s| s.shaft.is_none()) + on_shafts;
        if drivers != 1 {
            mistakes.add(
                "speeds.constant",
                format!("{drivers} sprockets and shafts have a prescribed speed"),
                "give exactly one a `[speeds.constant.NAME]`",
            );
        }
        for k in 0..self.shafts.len() {
            let mut on = self.sprockets.iter().filter(|s| s.shaft == Some(k));
            // A shaft without sprockets hangs on couplings.
            let Some(first) = on.next() else { continue };
            for s in on {
                if (s.x_m, s.y_m) != (first.x_m, first.y_m) {
                    mistakes.add(
                        &format!("sprockets.{}.x_mm", s.name),
                        format!("sprockets `{}` and `{}` sit on one shaft and not at one place", first.name, s.name),
                        "give both the same `x_mm` and `y_mm`",
                    );
                }
                if s.chain == first.chain {
                    mistakes.add(
                        &format!("sprockets.{}.shaft", s.name),
                        format!("sprockets `{}` and `{}` of one chain sit on one shaft", first.name, s.name),
                        "a chain that meets one shaft twice is not there yet",
                    );
                }
            }
        }
    }

    /// Checks that need more than one value.
    pub(super) fn check(&self) -> Result<(), Report> {
        let mut mistakes = DriveErrors::new(self);
        self.check_links(&mut mistakes);
        self.check_sides(&mut mistakes);
        self.check_faults(&mut mistakes);
        self.check_rails(&mut mistakes);
        self.check_guides(&mut mistakes);
        mistakes.report()
    }

    /// Links and plates of the chain.
    fn check_links(&self, mistakes: &mut DriveErrors<'_>) {
        let chain = self.chain.path();
        if !self.links.is_multiple_of(2) {
            mistakes.add(
                &format!("{chain}.links"),
                format!("`{chain}.links` = {} is odd", self.links),
                "the two kinds of links alternate: take an even number",
            );
        }
        let round = match self.chain {
            ChainSpec::Bush(c) => Some((c.pin_diameter_m, c.bush_diameter_m, c.plate_height_m)),
            ChainSpec::Abutment(c) => Some((c.pin_diameter_m, c.bush_diameter_m, c.plate_height_m)),
            ChainSpec::Silent(_) => None,
        };
        let rows = match self.chain {
            ChainSpec::Bush(c) => [c.inner.pitch_m, c.outer.pitch_m],
            ChainSpec::Abutment(c) => c.pitches_m,
            ChainSpec::Silent(c) => [c.even.pin_pitch_m, c.odd.pin_pitch_m],
        };
        let key = if matches!(self.chain, ChainSpec::Silent(_)) { "pin_pitch_mm" } else { "pitch_mm" };
        let nominal_m = self.chain.pitch_m();
        for (row, pitch_m) in ["inner", "outer"].iter().zip(rows) {
            if pitch_m.is_some_and(|p| (p / nominal_m - 1.0).abs() > LARGEST_PITCH_ERROR) {
                let range = [1.0 - LARGEST_PITCH_ERROR, 1.0 + LARGEST_PITCH_ERROR].map(|share| share * nominal_m * 1e3);
                mistakes.add(
                    &format!("{chain}.{row}.{key}"),
                    format!(
                        "`{chain}.{row}.{key}` = {} mm is far from the sprockets' pitch of {} mm",
                        pitch_m.unwrap_or(0.0) * 1e3,
                        nominal_m * 1e3
                    ),
                    &format!("teeth bear {:.3} to {:.3} mm", range[0], range[1]),
                );
            }
        }
        if let Some((pin_m, bush_m, plate_m)) = round {
            if pin_m >= bush_m {
                mistakes.add(
                    &format!("{chain}.pin_diameter_mm"),
                    "the pin does not fit into the bush".into(),
                    "make it smaller than `bush_diameter_mm`",
                );
            }
            if bush_m >= plate_m {
                mistakes.add(
                    &format!("{chain}.plate_height_mm"),
                    "the plate is no higher than the bush".into(),
                    "make it larger than `bush_diameter_mm`",
                );
            }
        }
        if let ChainSpec::Bush(c) = self.chain
            && let Some(r) = c.rollers
        {
            if 0.5 * c.bush_diameter_m + r.clearance_m >= 0.5 * r.diameter_m {
                mistakes.add(
                    &format!("{chain}.rollers.diameter_mm"),
                    "the roller has no wall left about its bush".into(),
                    "make it larger than `bush_diameter_mm` and the play in its bore",
                );
            }
            let by_radius = self.roller_contact.and_then(|c| needs_radius(&c.law));
            if let Some(key) = by_radius {
                mistakes.add(
                    &format!("contact.roller.{key}"),
                    "bush and bore are too much alike for this law: its contact would be as wide as the bush".into(),
                    "take the linear law, or one with a restitution",
                );
            }
        }
    }

    /// Contours that lie on one side of the chain, and their laws.
    fn check_sides(&self, mistakes: &mut DriveErrors<'_>) {
        if let ChainSpec::Abutment(c) = self.chain {
            let stretch_m = c.design_tension_n / self.joint.stiffness_n_per_m;
            if stretch_m > 0.02 * c.pitch_m {
                mistakes.add(
                    "chain.smartchain.design_tension_n",
                    format!("the design tension stretches a link by {:.0} um", stretch_m * 1e6),
                    "make it smaller or the joints stiffer: at most 2 % of the pitch",
                );
            }
            if self.sprockets.iter().any(|s| s.teeth < c.teeth && s.ring == RingForm::Conjugate) {
                mistakes.add(
                    "chain.smartchain.teeth",
                    format!("the abutments are made for {} teeth, and a sprocket has fewer", c.teeth),
                    "make them for the sprocket with the fewest teeth",
                );
            }
            // Where something presses on the backs of the links, a face holds their abutments.
            let is_held = |span: usize| self.guides.iter().any(|g| g.span == span && g.side == GuideSide::Inside);
            let fixed = self.guides.iter().map(|g| ("fixed", &g.name, g.side, g.span));
            let on_backs = fixed.chain(self.rails.iter().map(|r| ("rail", &r.name, r.side, r.span)));
            for (kind, name, _, _) in on_backs.filter(|(.., side, span)| *side == GuideSide::Outside && !is_held(*span))
            {
                mistakes.add(
                    &format!("guides.{kind}.{name}"),
                    format!("abutments lie inside the loop, and guide `{name}` outside"),
                    "set its `side` to \"inside\", or give its span a straight guide inside too",
                );
            }
        }
        let contours = match self.chain {
            ChainSpec::Bush(_) => Vec::new(),
            ChainSpec::Silent(_) => vec![("sprocket", self.tooth_contact.law)],
            ChainSpec::Abutment(_) => vec![("ring", self.ring_contact.law), ("guide", self.guide_contact.law)],
        };
        for (name, law) in contours {
            if let Some(key) = needs_radius(&law) {
                mistakes.add(
                    &format!("contact.{name}.{key}"),
                    "flanks and abutments have no constant radius for this law".into(),
                    "take the linear law, or one with a restitution",
                );
            }
        }
        if matches!(self.chain, ChainSpec::Silent(_)) && self.guides.iter().any(|g| g.side == GuideSide::Inside) {
            mistakes.add(
                "guides.fixed",
                "a silent chain has its teeth inside the loop, and a guide lies there".into(),
                "set its `side` to \"outside\"",
            );
        }
        if !matches!(self.chain, ChainSpec::Bush(_)) && self.sprockets.iter().any(|s| s.wrap == Wrap::Outside) {
            mistakes.add(
                "sprockets",
                "this chain has teeth or abutments on one side only, and a sprocket is wrapped outside".into(),
                "wrap all sprockets inside",
            );
        }
    }

    /// Effects and sensors on single gaps, links and joints.
    fn check_faults(&self, mistakes: &mut DriveErrors<'_>) {
        for e in &self.effects.gap_errors {
            let s = &self.sprockets[e.sprocket];
            if e.gap >= s.teeth {
                mistakes.add(
                    &gap_error::ROW.path(&s.name, "gap"),
                    format!("sprocket `{}` has no gap {}", s.name, e.gap),
                    &format!("its gaps are numbered 0 to {}", s.teeth - 1),
                );
            }
        }
        for s in &self.sensors {
            if let SensorReads::Link(link) = s.reads
                && link >= self.links
            {
                let help = format!("links are numbered 0 to {}", self.links - 1);
                mistakes.add(&format!("{}.link", s.path), format!("the chain has no link {link}"), &help);
            }
        }
        for e in self.effects.tight_joints.iter().filter(|e| e.joint >= self.links) {
            mistakes.add(
                &tight_joint::ROW.path(&e.name, "joint"),
                format!("the chain has no joint {}", e.joint),
                &format!("joints are numbered 0 to {}", self.links - 1),
            );
        }
        for (effect, name, link) in self.link_effects().filter(|(_, _, link)| *link >= self.links) {
            mistakes.add(
                &effect.path(name, "link"),
                format!("the chain has no link {link}"),
                &format!("links are numbered 0 to {}", self.links - 1),
            );
        }
    }

    /// Effects on single links: their rows, names and links.
    fn link_effects(&self) -> impl Iterator<Item = (&'static Effect, &str, usize)> {
        let longer = self.effects.pitch_errors.iter().map(|e| (&pitch_error::ROW, e.name.as_str(), e.link));
        let heavier = self.effects.link_masses.iter().map(|e| (&link_mass::ROW, e.name.as_str(), e.link));
        longer.chain(heavier)
    }

    /// Rails, and the arm that tightens the chain.
    fn check_rails(&self, mistakes: &mut DriveErrors<'_>) {
        if matches!(self.chain, ChainSpec::Abutment(_)) && self.rails.iter().any(|r| r.side == GuideSide::Inside) {
            mistakes.add(
                "guides.rail",
                "abutments lie inside the loop and run on straight faces there".into(),
                "take straight guides inside (`[guides.fixed.NAME]`), or set its `side` to \"outside\"",
            );
        }
        if matches!(self.chain, ChainSpec::Silent(_)) && self.rails.iter().any(|r| r.side == GuideSide::Inside) {
            mistakes.add(
                "guides.rail",
                "a silent chain has its teeth inside the loop, and a rail lies there".into(),
                "set its `side` to \"outside\"",
            );
        }
        for r in &self.rails {
            if let Err(e) = Rail::new(r.side, r.start, r.heading_rad, &r.stretches) {
                mistakes.add(
                    &format!("guides.rail.{}.lengths_mm", r.name),
                    format!("rail `{}` cannot be made: {e}", r.name),
                    "stretches have a length, and part a large turn in two",
                );
            }
        }
        for arm in self.arms.iter().filter(|a| a.spring_nm_per_rad == 0.0 && a.spring_torque_nm != 0.0) {
            mistakes.add(
                &format!("arms.{}.spring_torque_nm", arm.name),
                format!("arm `{}` has no spring for its torque", arm.name),
                "give it `spring_nm_per_rad`",
            );
        }
        for (index, arm) in self.arms.iter().enumerate() {
            if arm.spring_nm_per_rad == 0.0 && self.sliders.iter().all(|s| s.arm != index) {
                mistakes.add(
                    &format!("arms.{}", arm.name),
                    format!("nothing holds arm `{}`", arm.name),
                    "give it `spring_nm_per_rad` and `spring_torque_nm`, or a slider that `presses` on it",
                );
            }
        }
        for arm in &self.arms {
            if let (Some(low), Some(high)) = (arm.low_rad, arm.high_rad)
                && low >= high
            {
                mistakes.add(
                    &format!("arms.{}.high_deg", arm.name),
                    format!("arm `{}` has no way between its stops", arm.name),
                    "make `high_deg` larger than `low_deg`",
                );
            }
        }
        if let PreloadSpec::Arm(arm) = self.preload
            && !self.rails.iter().any(|r| r.arm == Some(arm))
        {
            mistakes.add(
                "preload.moves",
                format!("arm `{}` carries no rail", self.arms[arm].name),
                "give a rail this `arm`",
            );
        }
    }

    /// Guides, and what prescribes a speed.
    fn check_guides(&self, mistakes: &mut DriveErrors<'_>) {
        for b in &self.bearings {
            let (kind, name) = match b.on {
                Carried::Guide(k) => ("guide", &self.guides[k].name),
                Carried::Rail(k) => ("rail", &self.rails[k].name),
                Carried::Sprocket(_) | Carried::Shaft(_) => continue,
            };
            if let Some((_, mount)) = self.effects.mounts().find(|(guide, _)| guide == name) {
                mistakes.add(
                    &mount.path,
                    format!("{kind} `{name}` stands on `{}` already", b.path),
                    "keep one of them",
                );
            }
        }
        let drivers = self.sprockets.iter().filter(|s| matches!(s.outer, OuterSpec::Speed { .. })).count();
        if drivers != 1 {
            mistakes.add(
                "speeds.constant",
                format!("{drivers} sprockets have a prescribed speed"),
                "give exactly one sprocket a `[speeds.constant.NAME]`",
            );
        }
        let sides = |side| self.guides.iter().filter(move |g| g.side == side);
        for (i, g) in self.guides.iter().enumerate() {
            if sides(g.side).take_while(|o| o.name != g.name).any(|o| o.span == g.span) {
                mistakes.add(
                    &format!("guides.fixed.{}", g.name),
                    format!("guide `{}` lies on the same side of the same span as another", self.guides[i].name),
                    "join the two, or move one to the other side",
                );
            }
        }
    }
}
