//! `pitchline geometry smartchain`: the transition, the abutment and the rings of an abutment chain.

use super::{Failure, Outcome, add_field, print_json, print_out};
use crate::geometry::chain::abutment::Handover;
use crate::geometry::smartchain::{Abutment, AbutmentSpec, Inclination, LobedRing, TwoLinks};
use crate::units::{DEG, MM, UM};
use std::path::PathBuf;

#[derive(clap::Args, Debug)]
pub struct SmartchainArgs {
    /// Number of teeth for which the abutments are designed, 9 to 150
    #[arg(long)]
    teeth: u32,
    /// Chain pitch [mm]
    #[arg(long)]
    pitch_mm: f64,
    /// Distance of the abutment's end arc from the joint [mm]; the ring's radius is the pitch radius minus this
    #[arg(long)]
    abutment_mm: f64,
    /// Inclination of the link at hand-over [deg]; that of continuous acceleration if not given
    #[arg(long, value_parser = super::finite, conflicts_with = "two_links")]
    inclination_deg: Option<f64>,
    /// Hand the joint over within two links; of the next four options, those not given are chosen for the smallest peak
    /// of jerk
    #[arg(long)]
    two_links: bool,
    /// Height of the line of joints above the pitch circle [um]
    #[arg(long, value_parser = super::finite, requires = "two_links", allow_negative_numbers = true)]
    rise_um: Option<f64>,
    /// Angle from the top at which a joint reaches the pitch circle [deg]
    #[arg(long, value_parser = super::finite, requires = "two_links")]
    handover_deg: Option<f64>,
    /// Position along the chain at which a joint leaves the line, relative to the axis, negative before it [mm]
    #[arg(long, value_parser = super::finite, requires = "two_links", allow_negative_numbers = true)]
    line_end_mm: Option<f64>,
    /// Free part of the first link's inclination: tau^3 (1 - tau)^3 times b0, b1 tau and b2 tau^2 [deg]
    #[arg(
        long,
        requires = "two_links",
        value_parser = super::finite,
        value_delimiter = ',',
        num_args = 1,
        allow_hyphen_values = true,
        value_name = "B0,B1,B2"
    )]
    turn_deg: Vec<f64>,
    /// Teeth of a second sprocket, whose lobed ring fits the same abutments
    #[arg(long)]
    driven_teeth: Option<u32>,
    /// Draw path, abutments, ring and guide into an .svg file
    #[arg(short, long = "output", value_name = "FILE")]
    output: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub fn run(args: &SmartchainArgs) -> Result<Outcome, Failure> {
    for (name, value) in [("--pitch-mm", args.pitch_mm), ("--abutment-mm", args.abutment_mm)] {
        if !(value.is_finite() && value > 0.0) {
            return Err(Failure::Input(format!("`{name}` = {value} must be a positive number")));
        }
    }
    if args.turn_deg.len() > 3 {
        return Err(Failure::Input(format!("`--turn-deg` has {} numbers; three at most", args.turn_deg.len())));
    }
    let pitch_m = args.pitch_mm * MM;
    let handover = handover(args);
    let transition = handover.transition(args.teeth, pitch_m).map_err(|e| Failure::Input(e.to_string()))?;
    let spec = AbutmentSpec { distance_m: args.abutment_mm * MM, flat_m: None, end_angle_rad: None };
    let abutment = Abutment::new(transition, spec).map_err(|e| Failure::Input(e.to_string()))?;
    let ring = match args.driven_teeth {
        None => None,
        Some(teeth) => {
            let own = handover.smoothest().transition(teeth, pitch_m);
            let driven = own.map_err(|e| Failure::Input(format!("`--driven-teeth` {teeth}: {e}")))?;
            Some(LobedRing::new(&abutment, driven).map_err(|e| Failure::Input(e.to_string()))?)
        }
    };
    if let Some(path) = &args.output {
        if path.extension().and_then(|e| e.to_str()) != Some("svg") {
            return Err(Failure::Input(format!("{}: drawings end in .svg", path.display())));
        }
        let drawing = crate::render::smartchain_svg(&abutment, ring.as_ref())
            .map_err(|e| Failure::Input(format!("no drawing at this size: {e}")))?;
        crate::output::write(path, drawing.as_bytes())?;
    }
    if args.json {
        print_json(&as_json(&abutment, ring.as_ref()))
    } else {
        print_out(&as_text(&abutment, ring.as_ref()))
    }
}

/// The requested hand-over.
fn handover(args: &SmartchainArgs) -> Handover {
    if !args.two_links {
        let given = args.inclination_deg.map(|deg| Inclination::Given(deg * DEG));
        return Handover::OneLink(given.unwrap_or(Inclination::SmoothAcceleration));
    }
    let free = |k: usize| args.turn_deg.get(k).map_or(0.0, |b| b * DEG);
    Handover::TwoLinks(TwoLinks {
        rise_m: args.rise_um.map(|um| um * UM),
        handover_rad: args.handover_deg.map(|deg| deg * DEG),
        line_end_m: args.line_end_mm.map(|mm| mm * MM),
        free_rad: [free(0), free(1), free(2)],
    })
}

fn as_json(abutment: &Abutment, ring: Option<&LobedRing>) -> serde_json::Value {
    let t = &abutment.transition;
    let links = if t.turning.is_some() { 2 } else { 1 };
    let mut json = serde_json::json!({
        "teeth": t.teeth,
        "pitch_mm": t.pitch_m / MM,
        "abutment_mm": abutment.distance_m() / MM,
        "pitch_radius_mm": t.pitch_radius_m / MM,
        "rolling_radius_mm": t.rolling_radius_m / MM,
        "sigma": t.sigma,
        "inclination_deg": t.inclination_rad / DEG,
        "line_height_mm": t.line_height_m / MM,
        "handover_angle_deg": t.handover_angle_rad / DEG,
        "line_end_x_mm": t.line_end_x_m / MM,
        "circle_start_mm": [t.circle_start.x / MM, t.circle_start.y / MM],
        "c2": t.smooth_acceleration,
        "links": links,
        "peak_jerk": t.peak_jerk(),
        "ring_radius_mm": abutment.ring_radius_m / MM,
        "guide_height_mm": abutment.guide_height_m / MM,
        "rise_behind_hollow_um": abutment.rise_m / UM,
        "guide_overlap_um": abutment.guide_overlap_m / UM,
        "min_contour_radius_mm": abutment.min_radius_m / MM,
        "contour_arcs": abutment.front.arcs().len(),
        "contour_deviation_nm": abutment.max_deviation_m * 1e9,
        "neighbour_overlap_mm": abutment.neighbour_overlap_m() / MM,
        "planes": abutment.planes(),
        "own_gap_mm": abutment.own_gap_m() / MM,
    });
    if let Some(r) = ring {
        let driven = serde_json::json!({
            "teeth": r.transition.teeth,
            "line_height_mm": r.transition.line_height_m / MM,
            "valley_radius_mm": r.valley_radius_m / MM,
            "crest_radius_mm": r.crest_radius_m / MM,
            "envelope_end_radius_mm": r.envelope_end_radius_m / MM,
            "flank_start_deg": r.flank_start_rad / DEG,
            "envelope_end_deg": r.envelope_end_rad / DEG,
            "exact_until": r.exact_until,
            "lobe_arcs": r.tooth.len(),
            "lobe_deviation_nm": r.max_deviation_m * 1e9,
        });
        add_field(&mut json, "driven", driven);
    }
    json
}

fn as_text(abutment: &Abutment, ring: Option<&LobedRing>) -> String {
    let t = &abutment.transition;
    let row = |name: &str, value: f64, unit: &str| format!("{name:<26} {value:>12.5} {unit}\n");
    let acceleration = if t.smooth_acceleration { "continuous" } else { "jumps" };
    let links = if t.turning.is_some() { "two links" } else { "one link" };
    let mut text =
        format!("abutment chain, {} teeth, handed over within {links}, acceleration {acceleration}\n", t.teeth);
    text += &row("pitch radius", t.pitch_radius_m / MM, "mm");
    text += &row("rolling radius z p / 2 pi", t.rolling_radius_m / MM, "mm");
    if let Some(sigma) = t.sigma {
        text += &row("sigma", sigma, "of the link beyond the pitch point");
    }
    text += &row("inclination at hand-over", t.inclination_rad / DEG, "deg");
    text += &row("line of joints", t.line_height_m / MM, "mm above the axis");
    text += &row("  above the pitch circle", (t.line_height_m - t.pitch_radius_m) / UM, "um");
    text += &row("hand-over angle", t.handover_angle_rad / DEG, "deg");
    text += &row("line ends at x", t.line_end_x_m / MM, "mm");
    text += &row("circle starts at x", t.circle_start.x / MM, "mm");
    text += &row("circle starts at y", t.circle_start.y / MM, "mm");
    text += &row("largest jerk", t.peak_jerk(), "of w^3 R, at 60 places per link");
    text += &row("ring radius", abutment.ring_radius_m / MM, "mm");
    text += &row("guide face under joints", abutment.guide_height_m / MM, "mm");
    if abutment.rise_m > 0.0 {
        text += &row("contour over its flat", abutment.rise_m / UM, "um, behind a hollow");
        text += &row("rear one into the guide", abutment.guide_overlap_m / UM, "um, while the front joint rises");
    }
    text += &row("smallest contour radius", abutment.min_radius_m / MM, "mm");
    text += &row("arcs of the contour", abutment.front.arcs().len() as f64, "");
    text += &row("  deviation", abutment.max_deviation_m * 1e9, "nm");
    text += &row("overlap of neighbours", abutment.neighbour_overlap_m() / MM, "mm");
    text += &row("planes across the width", f64::from(abutment.planes()), "so that abutments of following links pass");
    if let Some(r) = ring {
        text += &format!("lobed ring, {} teeth\n", r.transition.teeth);
        text += &row("valley radius", r.valley_radius_m / MM, "mm");
        text += &row("crest radius", r.crest_radius_m / MM, "mm");
        text += &row("flank ahead of the seat", r.flank_start_rad / DEG, "deg");
        text += &row("exact until", r.exact_until, "of the hand-over");
        text += &row("arcs of a lobe", r.tooth.len() as f64, "");
        text += &row("  deviation", r.max_deviation_m * 1e9, "nm");
    }
    text
}
