//! `pitchline geometry chain --type silent` and `pitchline geometry sprocket --profile silent-arc|silent-line`.

use super::{Failure, Outcome, add_field, print_json, print_out};
use crate::geometry::Vec2;
use crate::geometry::chain::silent::{SilentLinkContour, SilentLinkForm};
use crate::geometry::silent_sprocket::{SilentSprocket, SilentSprocketSpec, ToothFace};
use crate::units::{DEG, MM, UM};
use std::path::{Path, PathBuf};

#[derive(clap::Args, Debug)]
pub struct ChainArgs {
    /// Chain type
    #[arg(long = "type", value_enum)]
    chain_type: ChainType,
    /// Chain pitch: distance of the joints of a link [mm]
    #[arg(long)]
    pitch_mm: f64,
    /// Distance of the virtual eyes from which the contour is constructed [mm]; the pitch if not given
    #[arg(long)]
    flank_pitch_mm: Option<f64>,
    #[command(flatten)]
    form: FormArgs,
    /// Draw the contour into an .svg file
    #[arg(short, long = "output", value_name = "FILE")]
    output: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug)]
enum ChainType {
    /// Inverted teeth, one round pin per joint
    Silent,
}

/// Proportions of a silent link; a sprocket is designed for its link.
#[derive(clap::Args, Clone, Copy, Debug)]
pub struct FormArgs {
    /// Silent: angle of both flanks to the normal of the pin line [deg]; 30 if not given
    #[arg(long)]
    flank_angle_deg: Option<f64>,
    /// Silent: distance of the outer flank from the eye [mm]; 0.375 of the pitch if not given
    #[arg(long)]
    face_distance_mm: Option<f64>,
    /// Silent: projection of the inner flank beyond the outer one [mm]; -0.0625 of the pitch if not given
    #[arg(long, allow_negative_numbers = true)]
    inside_projection_mm: Option<f64>,
    /// Silent: radius of the toe arc [mm]; 0.1 of the pitch if not given
    #[arg(long)]
    toe_radius_mm: Option<f64>,
    /// Silent: radius of the crotch arc [mm]; 0.15 of the pitch if not given
    #[arg(long)]
    crotch_radius_mm: Option<f64>,
}

impl FormArgs {
    fn form(&self, pitch_m: f64) -> SilentLinkForm {
        let standard = SilentLinkForm::standard(pitch_m);
        let mm = |given: Option<f64>, otherwise_m: f64| given.map_or(otherwise_m, |v| v * MM);
        SilentLinkForm {
            flank_angle_rad: self.flank_angle_deg.map_or(standard.flank_angle_rad, |v| v * DEG),
            face_distance_m: mm(self.face_distance_mm, standard.face_distance_m),
            inside_projection_m: mm(self.inside_projection_mm, standard.inside_projection_m),
            toe_radius_m: mm(self.toe_radius_mm, standard.toe_radius_m),
            crotch_radius_m: mm(self.crotch_radius_mm, standard.crotch_radius_m),
        }
    }

    /// The first of these options that was given.
    fn given(&self) -> Option<&'static str> {
        let FormArgs { flank_angle_deg, face_distance_mm, inside_projection_mm, toe_radius_mm, crotch_radius_mm } =
            self;
        [
            ("--flank-angle-deg", flank_angle_deg),
            ("--face-distance-mm", face_distance_mm),
            ("--inside-projection-mm", inside_projection_mm),
            ("--toe-radius-mm", toe_radius_mm),
            ("--crotch-radius-mm", crotch_radius_mm),
        ]
        .into_iter()
        .find_map(|(name, value)| value.is_some().then_some(name))
    }
}

/// Free dimensions of a silent chain tooth.
#[derive(clap::Args, Clone, Copy, Debug)]
pub struct ToothArgs {
    #[command(flatten)]
    form: FormArgs,
    /// Silent: gap between the toe of a seated link and the root [mm]; 0.1 of the pitch if not given
    #[arg(long)]
    root_clearance_mm: Option<f64>,
    /// Silent: radius of the tip corners [mm]; 0.05 of the pitch if not given
    #[arg(long)]
    corner_radius_mm: Option<f64>,
}

impl ToothArgs {
    /// The first of these options that was given.
    pub fn given(&self) -> Option<&'static str> {
        let own = [("--root-clearance-mm", self.root_clearance_mm), ("--corner-radius-mm", self.corner_radius_mm)];
        self.form.given().or_else(|| own.into_iter().find_map(|(name, value)| value.map(|_| name)))
    }
}

/// Arguments of the sprocket verb for a silent profile.
pub struct SilentSprocketRequest<'a> {
    pub teeth: u32,
    pub pitch_mm: f64,
    pub tip_diameter_mm: Option<f64>,
    pub face: ToothFace,
    pub tooth: ToothArgs,
    pub output: Option<&'a Path>,
    pub json: bool,
}

pub fn chain(args: &ChainArgs) -> Result<Outcome, Failure> {
    let ChainType::Silent = args.chain_type;
    check_pitch(args.pitch_mm)?;
    let pitch_m = args.pitch_mm * MM;
    let flank_pitch_m = args.flank_pitch_mm.map_or(pitch_m, |v| v * MM);
    let link = SilentLinkContour::new(args.form.form(pitch_m), pitch_m, flank_pitch_m)
        .map_err(|e| Failure::Input(e.to_string()))?;
    if let Some(path) = &args.output {
        let profile = link.profile().map_err(|e| Failure::World(e.to_string()))?;
        write_drawing(path, &crate::render::silent::link_svg(&link, &profile))?;
    }
    let rows = link_rows(&link);
    if args.json {
        let mut out = serde_json::json!({ "type": "silent" });
        for (key, _, value, _) in rows {
            add_field(&mut out, key, serde_json::json!(value));
        }
        return print_json(&out);
    }
    let text = "Silent chain link; heights count outwards from the pin line\n".to_string();
    print_out(&rows.iter().fold(text, |text, (_, name, value, unit)| text + &row(name, *value, unit)))
}

pub fn sprocket(request: &SilentSprocketRequest) -> Result<Outcome, Failure> {
    check_pitch(request.pitch_mm)?;
    let pitch_m = request.pitch_mm * MM;
    let tooth = &request.tooth;
    let standard = SilentSprocketSpec::standard(request.teeth, pitch_m, request.face);
    let mut spec = SilentSprocketSpec {
        link: tooth.form.form(pitch_m),
        root_clearance_m: tooth.root_clearance_mm.map_or(standard.root_clearance_m, |v| v * MM),
        corner_radius_m: tooth.corner_radius_mm.map_or(standard.corner_radius_m, |v| v * MM),
        ..standard
    };
    if let Some(tip_diameter_mm) = request.tip_diameter_mm {
        let chord_radius_m = 0.5 * pitch_m / libm::tan(std::f64::consts::PI / f64::from(request.teeth.max(3)));
        spec.tip_offset_m = 0.5 * tip_diameter_mm * MM - chord_radius_m;
    }
    let s = SilentSprocket::new(spec).map_err(|e| Failure::Input(e.to_string()))?;
    if let Some(path) = request.output {
        let profile = s.profile().map_err(|e| Failure::World(e.to_string()))?;
        write_drawing(path, &crate::render::silent::sprocket_svg(&s, &profile))?;
    }
    let rows = sprocket_rows(&s);
    let face = match spec.face {
        ToothFace::Line => "silent-line",
        ToothFace::Arc => "silent-arc",
        ToothFace::Crowned { .. } => "silent-crowned",
    };
    let points = [("corner_centre_mm", Some(s.corner_centre)), ("face_centre_mm", s.face_centre)];
    if request.json {
        let mut out = serde_json::json!({ "profile": face, "teeth": spec.teeth });
        for (key, _, value, _) in rows {
            add_field(&mut out, key, serde_json::json!(value));
        }
        for (key, point) in points {
            add_field(&mut out, key, serde_json::json!(point.map(|p: Vec2| [p.x / MM, p.y / MM])));
        }
        return print_json(&out);
    }
    let mut text =
        format!("Sprocket for silent chain, {} teeth, {face}; points with the tooth axis = +y\n", spec.teeth);
    for (_, name, value, unit) in rows {
        text += &match value {
            Some(value) => row(name, value, unit),
            None => format!("{name:<32} {:>12}\n", "none: straight"),
        };
    }
    for (name, point) in [("corner arc centre", points[0].1), ("face arc centre", points[1].1)] {
        if let Some(p) = point {
            text += &row(&format!("{name} x"), p.x / MM, "mm");
            text += &row(&format!("{name} y"), p.y / MM, "mm");
        }
    }
    print_out(&text)
}

/// JSON key, text, value, unit.
fn link_rows(link: &SilentLinkContour) -> [(&'static str, &'static str, f64, &'static str); 16] {
    let form = &link.form;
    [
        ("pitch_mm", "pin pitch", link.pin_pitch_m / MM, "mm"),
        ("flank_pitch_mm", "flank pitch", link.flank_pitch_m / MM, "mm"),
        ("flank_angle_deg", "flank angle", form.flank_angle_rad / DEG, "deg"),
        ("face_distance_mm", "outer face from eye", form.face_distance_m / MM, "mm"),
        ("inside_projection_mm", "inside projection", form.inside_projection_m / MM, "mm"),
        ("inner_face_distance_mm", "inner face from eye", form.inner_face_distance_m() / MM, "mm"),
        ("toe_radius_mm", "toe radius", form.toe_radius_m / MM, "mm"),
        ("crotch_radius_mm", "crotch radius", form.crotch_radius_m / MM, "mm"),
        ("toe_offset_mm", "toe centre beyond eye", form.toe_offset_m() / MM, "mm"),
        ("toe_depth_mm", "toe centre below pin line", form.toe_depth_m() / MM, "mm"),
        ("outer_flank_length_mm", "outer flank ends at", link.outer_flank_length_m / MM, "mm from eye foot"),
        ("inner_flank_end_mm", "inner flank ends at", link.inner_flank_end_m / MM, "mm from eye foot"),
        ("inner_flank_start_mm", "inner flank starts at", link.inner_flank_start_m / MM, "mm from eye foot"),
        ("crotch_centre_mm", "crotch centre height", link.crotch_centre_m / MM, "mm"),
        ("crotch_top_mm", "crotch top height", link.crotch_top_m() / MM, "mm"),
        ("toe_low_mm", "toe low height", link.toe_low_m() / MM, "mm"),
    ]
}

/// JSON key, text, value, unit; None if this face has no such dimension.
fn sprocket_rows(s: &SilentSprocket) -> [(&'static str, &'static str, Option<f64>, &'static str); 18] {
    let mm = |v: f64| Some(v / MM);
    [
        ("pitch_mm", "pitch", mm(s.spec.pitch_m), "mm"),
        ("pitch_radius_mm", "pitch radius", mm(s.pitch_radius_m), "mm"),
        ("chord_radius_mm", "seated pin line from axis", mm(s.chord_radius_m), "mm"),
        ("rolling_radius_mm", "rolling radius z p / (2 pi)", mm(s.rolling_radius_m), "mm"),
        ("half_tooth_angle_deg", "half tooth angle", Some(s.half_tooth_angle_rad / DEG), "deg"),
        ("half_gap_angle_deg", "half gap angle", Some(s.half_gap_angle_rad / DEG), "deg"),
        ("face_offset_mm", "face plane from axis", mm(s.face_offset_m), "mm"),
        ("face_radius_mm", "face radius", s.face_radius_m.and_then(mm), "mm"),
        ("base_radius_mm", "base radius", mm(s.base_radius_m), "mm"),
        ("contact_distance_mm", "contact from eye foot", s.contact_distance_m.and_then(mm), "mm"),
        ("tip_radius_mm", "tip radius", mm(s.tip_radius_m), "mm"),
        ("pointed_radius_mm", "tooth would be pointed at", mm(s.pointed_radius_m), "mm"),
        ("tip_land_mm", "tip land", mm(s.tip_land_m), "mm"),
        ("corner_radius_mm", "corner radius", mm(s.spec.corner_radius_m), "mm"),
        ("root_radius_mm", "root radius", mm(s.root_radius_m), "mm"),
        ("root_clearance_mm", "root clearance", mm(s.spec.root_clearance_m), "mm"),
        ("root_arc_radius_mm", "root arc radius", mm(s.root_arc_radius_m), "mm"),
        ("toe_clearance_um", "clearance of swinging toe", Some(s.toe_clearance_m / UM), "um"),
    ]
}

fn row(name: &str, value: f64, unit: &str) -> String {
    format!("{name:<32} {value:>12.6} {unit}\n")
}

fn check_pitch(pitch_mm: f64) -> Result<(), Failure> {
    if pitch_mm.is_finite() && pitch_mm > 0.0 {
        return Ok(());
    }
    Err(Failure::Input(format!("`--pitch-mm` = {pitch_mm} must be a positive number")))
}

fn write_drawing(path: &Path, svg: &str) -> Result<(), Failure> {
    if path.extension().and_then(|e| e.to_str()) != Some("svg") {
        return Err(Failure::Input(format!("{}: drawings end in .svg", path.display())));
    }
    Ok(crate::output::write(path, svg.as_bytes())?)
}
