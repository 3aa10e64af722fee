//! `pitchline geometry`: dimensions of a profile, and its drawing.

use super::geometry_silent::{self, ChainArgs, SilentSprocketRequest, ToothArgs};
use super::{Failure, Outcome, print_json, print_out};
use crate::geometry::silent_sprocket::ToothFace;
use crate::geometry::sprocket::{GapForm, Sprocket, SprocketSpec};
use crate::units::{DEG, MM};
use std::path::PathBuf;

#[derive(clap::Args, Debug)]
pub struct GeometryArgs {
    #[command(subcommand)]
    verb: GeometryVerb,
}

#[derive(clap::Subcommand, Debug)]
enum GeometryVerb {
    /// A sprocket tooth after ISO 606, or for silent chain
    Sprocket(SprocketArgs),
    /// A chain link
    Chain(ChainArgs),
    /// The abutments and rings of an abutment chain
    Smartchain(super::geometry_smartchain::SmartchainArgs),
}

#[derive(clap::Args, Debug)]
pub struct SprocketArgs {
    /// Tooth profile
    #[arg(long, value_enum, default_value = "iso606")]
    profile: ToothProfile,
    /// Number of teeth, 9 to 150
    #[arg(long)]
    teeth: u32,
    /// Chain pitch [mm]
    #[arg(long)]
    pitch_mm: f64,
    /// Roller or bush diameter [mm]; required for ISO 606
    #[arg(long)]
    roller_mm: Option<f64>,
    /// Minimum or maximum tooth gap form of ISO 606; max if not given
    #[arg(long, value_enum)]
    form: Option<Form>,
    /// Tip diameter [mm]; if not given, the middle of the ISO 606 range, for silent chain that of the seated pin line
    #[arg(long)]
    tip_mm: Option<f64>,
    #[command(flatten)]
    silent: ToothArgs,
    /// Draw the contour into an .svg file
    #[arg(short, long = "output", value_name = "FILE")]
    output: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug)]
enum ToothProfile {
    /// Roller and bush chain
    Iso606,
    /// Silent chain, face is an arc that osculates the involute
    SilentArc,
    /// Silent chain, straight face
    SilentLine,
}

#[derive(clap::ValueEnum, Clone, Copy, Debug)]
enum Form {
    Min,
    Max,
}

pub fn run(args: &GeometryArgs) -> Result<Outcome, Failure> {
    match &args.verb {
        GeometryVerb::Sprocket(args) => match args.profile {
            ToothProfile::Iso606 => iso_606_sprocket(args),
            ToothProfile::SilentArc => silent_sprocket(args, ToothFace::Arc),
            ToothProfile::SilentLine => silent_sprocket(args, ToothFace::Line),
        },
        GeometryVerb::Chain(args) => geometry_silent::chain(args),
        GeometryVerb::Smartchain(args) => super::geometry_smartchain::run(args),
    }
}

fn silent_sprocket(args: &SprocketArgs, face: ToothFace) -> Result<Outcome, Failure> {
    let foreign = [("--roller-mm", args.roller_mm.is_some()), ("--form", args.form.is_some())];
    if let Some((name, _)) = foreign.iter().find(|(_, given)| *given) {
        return Err(Failure::Input(format!("`{name}` belongs to `--profile iso606`; silent chain has no rollers")));
    }
    geometry_silent::sprocket(&SilentSprocketRequest {
        teeth: args.teeth,
        pitch_mm: args.pitch_mm,
        tip_diameter_mm: args.tip_mm,
        face,
        tooth: args.silent,
        output: args.output.as_deref(),
        json: args.json,
    })
}

fn iso_606_spec(args: &SprocketArgs, form: Form) -> Result<SprocketSpec, Failure> {
    if let Some(name) = args.silent.given() {
        return Err(Failure::Input(format!("`{name}` belongs to `--profile silent-arc` and `silent-line`")));
    }
    let Some(roller_mm) = args.roller_mm else {
        return Err(Failure::Input(
            "`--profile iso606` needs the diameter of the roller or bush: `--roller-mm`".into(),
        ));
    };
    for (name, value) in [("--pitch-mm", args.pitch_mm), ("--roller-mm", roller_mm)] {
        if !(value.is_finite() && value > 0.0) {
            return Err(Failure::Input(format!("`{name}` = {value} must be a positive number")));
        }
    }
    Ok(SprocketSpec {
        teeth: args.teeth,
        pitch_m: args.pitch_mm * MM,
        roller_diameter_m: roller_mm * MM,
        form: match form {
            Form::Min => GapForm::Min,
            Form::Max => GapForm::Max,
        },
        tip_diameter_m: args.tip_mm.map(|d| d * MM),
    })
}

fn iso_606_sprocket(args: &SprocketArgs) -> Result<Outcome, Failure> {
    let form = args.form.unwrap_or(Form::Max);
    let sprocket = Sprocket::new(iso_606_spec(args, form)?).map_err(|e| Failure::Input(e.to_string()))?;
    if let Some(path) = &args.output {
        if path.extension().and_then(|e| e.to_str()) != Some("svg") {
            return Err(Failure::Input(format!("{}: drawings end in .svg", path.display())));
        }
        let profile = sprocket.profile().map_err(|e| Failure::World(e.to_string()))?;
        crate::output::write(path, crate::render::sprocket_svg(&sprocket, &profile).as_bytes())?;
    }
    let s = &sprocket;
    if args.json {
        return print_json(&serde_json::json!({
            "teeth": s.spec.teeth,
            "pitch_mm": s.spec.pitch_m / MM,
            "roller_diameter_mm": s.spec.roller_diameter_m / MM,
            "form": s.spec.form,
            "pitch_diameter_mm": 2.0 * s.pitch_radius_m / MM,
            "rolling_diameter_mm": 2.0 * s.rolling_radius_m() / MM,
            "root_diameter_mm": 2.0 * s.root_radius_m / MM,
            "tip_diameter_mm": 2.0 * s.tip_radius_m / MM,
            "tip_diameter_min_mm": 2.0 * s.tip_radius_min_m / MM,
            "tip_diameter_max_mm": 2.0 * s.tip_radius_max_m / MM,
            "seat_radius_mm": s.seat_radius_m / MM,
            "seat_angle_deg": s.seat_angle_rad / DEG,
            "flank_radius_mm": s.flank_radius_m / MM,
            "flank_centre_mm": [s.flank_centre.x / MM, s.flank_centre.y / MM],
            "pointed_radius_mm": s.pointed_radius_m / MM,
            "tip_land_mm": s.tip_land_m / MM,
            "seat_pressure_angle_deg": s.seat_pressure_angle_rad / DEG,
            "articulation_clearance_um": s.articulation_clearance_m * 1e6,
        }));
    }
    let row = |name: &str, value: f64, unit: &str| format!("{name:<26} {value:>12.5} {unit}\n");
    let mut text = format!("ISO 606 sprocket, {} teeth, {:?} gap form\n", s.spec.teeth, form);
    text += &row("pitch diameter", 2.0 * s.pitch_radius_m / MM, "mm");
    text += &row("rolling diameter z p / pi", 2.0 * s.rolling_radius_m() / MM, "mm");
    text += &row("root diameter", 2.0 * s.root_radius_m / MM, "mm");
    text += &row("tip diameter", 2.0 * s.tip_radius_m / MM, "mm");
    text += &row("  smallest", 2.0 * s.tip_radius_min_m / MM, "mm");
    text += &row("  largest", 2.0 * s.tip_radius_max_m / MM, "mm");
    text += &row("  flanks would meet at", 2.0 * s.pointed_radius_m / MM, "mm");
    text += &row("tip land", s.tip_land_m / MM, "mm");
    text += &row("seat radius", s.seat_radius_m / MM, "mm");
    text += &row("seat angle", s.seat_angle_rad / DEG, "deg");
    text += &row("flank radius", s.flank_radius_m / MM, "mm");
    text += &row("flank centre x", s.flank_centre.x / MM, "mm (gap axis = +y)");
    text += &row("flank centre y", s.flank_centre.y / MM, "mm");
    text += &row("pressure angle, seat end", s.seat_pressure_angle_rad / DEG, "deg");
    text += &row("clearance of swinging bush", s.articulation_clearance_m * 1e6, "um");
    print_out(&text)
}
