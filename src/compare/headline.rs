//! Summary numbers of a chain, all on the driver, in the engagement window [`super::WINDOW_T`].
//!
//! * engagement: a link's passage onto the driver (a pass of [`crate::engagement`]).
//! * approach speed: of the fastest first contact of any kind; p50: the largest of the kinds' medians.
//! * peak force: the largest normal force of any kind in any step of the window.
//! * steady force: of the contact that seats the link in the teeth, median over the wrap from the second pitch on.
//! * rise time: from a tenth to nine tenths of that contact's first force rise.
//! * impulse: time integral of its force from first contact until it has fallen to half its peak, or for one tooth
//!   period.
//! * contact sequence: guide, ring, bush, rear abutment of an abutment chain; else the most common order of kinds.

use super::{DriveSummary, WINDOW_T};
use crate::engagement::{BINS_PER_PITCH, ContactKind, KINDS, Pass};
use crate::statistics::median;
use std::collections::BTreeMap;

/// Highest approach speed that still counts as impact-free, relative to p omega.
const NO_IMPACT_SHARE: f64 = 0.03;

/// Definitions are at the head of this file.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct Headline {
    pub engagements: usize,
    pub approach_speed_p50_m_s: f64,
    pub approach_speed_max_m_s: f64,
    pub peak_force_p50_n: f64,
    pub peak_force_max_n: f64,
    pub steady_force_n: f64,
    pub peak_to_steady: f64,
    pub rise_time_p50_s: f64,
    pub impulse_p50_n_s: f64,
    pub contact_sequence_share: f64,
    /// Tooth order, peak to peak over the mean.
    pub span_speed_ripple: f64,
    pub verdict: String,
}

/// Headline of a run. `wrap_t` is the wrap on the driver in tooth periods.
pub fn headline(summary: &DriveSummary, passes: &[Pass], period_s: f64, wrap_t: f64) -> Headline {
    let (from, to) = WINDOW_T;
    let fastest = |f: &dyn Fn(&super::KindSummary) -> f64| summary.kinds.iter().map(f).fold(0.0, f64::max);
    let peak = |p: &Pass| KINDS.iter().map(|k| p.peak(*k, from, to)).fold(0.0, f64::max);
    let seat = summary.tooth().map(|k| k.kind);
    let steady_force_n = seat.map_or(f64::NAN, |kind| median(passes.iter().map(|p| steady(p, kind, wrap_t))));
    let peak_force_p50_n = median(passes.iter().map(peak));
    let approach_speed_max_m_s = summary.fastest_touch_m_s();
    let share = approach_speed_max_m_s / summary.turning_speed_m_s;
    Headline {
        engagements: passes.len(),
        approach_speed_p50_m_s: fastest(&|k| k.approach_median_m_s),
        approach_speed_max_m_s,
        peak_force_p50_n,
        peak_force_max_n: passes.iter().map(peak).fold(0.0, f64::max),
        steady_force_n,
        peak_to_steady: peak_force_p50_n / steady_force_n,
        rise_time_p50_s: summary.tooth().map_or(f64::NAN, |k| k.rise_t * period_s),
        impulse_p50_n_s: seat.map_or(f64::NAN, |kind| median(passes.iter().filter_map(|p| impulse(p, kind, period_s)))),
        contact_sequence_share: summary.sequence.unwrap_or_else(|| most_common_order(passes)),
        span_speed_ripple: summary.speed_ripple,
        verdict: if share <= NO_IMPACT_SHARE {
            format!("engages without impact: fastest touch {:.2} % of p omega", 100.0 * share)
        } else {
            format!("strikes with {:.1} % of p omega", 100.0 * share)
        },
    }
}

/// Median force from the second pitch to one pitch before the end of the wrap [N].
fn steady(pass: &Pass, kind: ContactKind, wrap_t: f64) -> f64 {
    let on_wrap = |bin: &usize| (1.0..wrap_t - 1.0).contains(&Pass::u_of(*bin));
    median((0..pass.force_n.len()).filter(on_wrap).map(|bin| pass.force_n[bin][kind as usize]))
}

/// Impulse [N s]; None if the pass has no contact of the kind.
fn impulse(pass: &Pass, kind: ContactKind, period_s: f64) -> Option<f64> {
    let (u, _) = pass.first_touch[kind as usize]?;
    let force = |bin: usize| pass.force_n[bin][kind as usize];
    let start = (0..pass.force_n.len()).find(|bin| Pass::u_of(*bin) + 0.5 / BINS_PER_PITCH as f64 >= u)?;
    let end = (start + BINS_PER_PITCH).min(pass.force_n.len());
    let top = (start..end).max_by(|a, b| force(*a).total_cmp(&force(*b)))?;
    let until = (top..end).find(|bin| force(*bin) <= 0.5 * force(top)).unwrap_or(end);
    Some((start..until).map(force).sum::<f64>() * period_s / BINS_PER_PITCH as f64)
}

fn most_common_order(passes: &[Pass]) -> f64 {
    let mut counts: BTreeMap<Vec<usize>, usize> = BTreeMap::new();
    for pass in passes {
        let mut order: Vec<usize> = (0..KINDS.len()).filter(|k| pass.first_touch[*k].is_some()).collect();
        let at = |k: &usize| pass.first_touch[*k].map_or(0.0, |t| t.0);
        order.sort_by(|a, b| at(a).total_cmp(&at(b)));
        *counts.entry(order).or_default() += 1;
    }
    counts.values().copied().max().unwrap_or(0) as f64 / passes.len().max(1) as f64
}
