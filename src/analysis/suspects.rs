//! Which tooth, link, guide or row of links stands out among all impacts.
//!
//! Impacts are put into groups by one thing they have in common (tooth gap of a sprocket, joint of the chain, part of a guide)
//! and compared with the other groups of the same kind on the same body, by the median of a quantity in each group. A group
//! stands out when its median lies further from that of the others than [`SCORE`] times their own spread (1.4826 x median
//! absolute deviation of the groups' medians, which is one standard deviation of normal noise), and by at least [`SHARE`] of it.

use crate::recording::frame::{Feature, Header, Impact};
use std::collections::BTreeMap;

/// Spreads from which on a group stands out.
const SCORE: f64 = 6.0;
/// Smallest departure that counts, as a share of the others' median.
const SHARE: f64 = 0.1;
/// Fewest groups that make a kind, and fewest impacts that make a group.
const FEWEST_GROUPS: usize = 6;

/// Something that stands out.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Suspect {
    /// `tooth`, `joint`, `guide`, `sprocket`.
    pub kind: &'static str,
    /// Path of the body.
    pub body: String,
    pub tooth: Option<u32>,
    /// Links that meet in the joint, the one behind it first.
    pub links: Option<[u32; 2]>,
    /// Quantity of the impacts that it stands out by, its median there and among the others.
    pub quantity: &'static str,
    pub median: f64,
    pub others: f64,
    /// Distance in spreads of the others.
    pub score: f64,
    pub impacts: usize,
    /// Time of the first of them [s].
    pub first_s: f64,
    pub text: String,
}

/// Quantities that groups are compared by: name, unit, factor for text.
const QUANTITIES: [(&str, &str, f64); 3] =
    [("peak_force_n", "N", 1.0), ("approach_speed_m_s", "m/s", 1.0), ("second_period_mean_n", "N", 1.0)];

fn quantity(i: &Impact, q: usize) -> f64 {
    [i.peak_force_n, i.approach_speed_m_s, i.second_period_mean_n][q]
}

/// What stands out, the furthest first.
pub fn suspects(impacts: &[Impact], header: &Header) -> Vec<Suspect> {
    let mut found = Vec::new();
    for (body, info) in header.bodies.iter().enumerate().filter(|(_, b)| b.rotor) {
        let own: Vec<&Impact> = impacts.iter().filter(|i| i.body as usize == body).collect();
        for q in 0..QUANTITIES.len() {
            let by_tooth = groups(&own, |i| i.tooth);
            outliers(&by_tooth, q, |tooth, score, median, others, group| {
                found.push(suspect("tooth", &info.path, Some(tooth), None, q, (median, others, score), group));
            });
            let bushes: Vec<&Impact> = own.iter().copied().filter(|i| i.feature <= Feature::FrontBush as u32).collect();
            let n = header.links.len() as u32;
            let by_joint =
                groups(&bushes, |i| if i.feature == Feature::FrontBush as u32 { i.link } else { (i.link + n - 1) % n });
            outliers(&by_joint, q, |joint, score, median, others, group| {
                let links = Some([joint, (joint + 1) % n]);
                found.push(suspect("joint", &info.path, None, links, q, (median, others, score), group));
            });
        }
    }
    found.sort_by(|a: &Suspect, b: &Suspect| b.score.total_cmp(&a.score));
    found
}

fn groups<'a>(impacts: &[&'a Impact], key: impl Fn(&Impact) -> u32) -> BTreeMap<u32, Vec<&'a Impact>> {
    let mut all: BTreeMap<u32, Vec<&Impact>> = BTreeMap::new();
    for i in impacts {
        all.entry(key(i)).or_default().push(i);
    }
    all
}

fn outliers(groups: &BTreeMap<u32, Vec<&Impact>>, q: usize, mut each: impl FnMut(u32, f64, f64, f64, &[&Impact])) {
    if groups.len() < FEWEST_GROUPS {
        return;
    }
    let medians: Vec<f64> = groups.values().map(|g| median(g.iter().map(|i| quantity(i, q)).collect())).collect();
    let centre = median(medians.clone());
    let spread = 1.4826 * median(medians.iter().map(|m| (m - centre).abs()).collect());
    for ((key, group), m) in groups.iter().zip(&medians) {
        let score = (m - centre).abs() / spread.max(1e-12);
        if score >= SCORE && (m - centre).abs() >= SHARE * centre.abs() {
            each(*key, score, *m, centre, group);
        }
    }
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    if n == 0 {
        return f64::NAN;
    }
    0.5 * (values[(n - 1) / 2] + values[n / 2])
}

fn suspect(
    kind: &'static str,
    body: &str,
    tooth: Option<u32>,
    links: Option<[u32; 2]>,
    q: usize,
    (median, others, score): (f64, f64, f64),
    group: &[&Impact],
) -> Suspect {
    let (quantity, unit, factor) = QUANTITIES[q];
    let first_s = group.iter().map(|i| i.t_s).fold(f64::INFINITY, f64::min);
    let who = match (tooth, links) {
        (Some(tooth), _) => format!("{body}, tooth gap {tooth}"),
        (_, Some([a, b])) => format!("the joint of links {a} and {b}, on {body}"),
        _ => body.to_string(),
    };
    let name = quantity.trim_end_matches("_n").trim_end_matches("_m_s").replace('_', " ");
    let text = format!(
        "{who}: {name} {:.3} {unit} where the others have {:.3} {unit} ({score:.0} spreads; {} impacts, the first at {:.4} ms)",
        median * factor,
        others * factor,
        group.len(),
        first_s * 1e3
    );
    Suspect {
        kind,
        body: body.to_string(),
        tooth,
        links,
        quantity,
        median,
        others,
        score,
        impacts: group.len(),
        first_s,
        text,
    }
}
