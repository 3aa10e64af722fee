//! A layout for Foxglove that calls the bodies of a recording by their names. It is `assets/foxglove/pitchline.json`, which fits any recording, with
//! the curves of this one, each body in one colour everywhere, and the camera on the whole drive.

use super::contact_labels::short_name;
use super::foxglove_scene::ForceArrows;
use super::frame::{BodyInfo, Header};
use super::palette::{CURVE_COLOURS, hex};
use super::view_geometry::scene_bounds;
use anyhow::{Context, Result};
use serde_json::{Value, json};

const TEMPLATE: &str = include_str!("../../assets/foxglove/pitchline.json");

/// Room about the drive in the picture, as a share of its size: chains stand over their sprockets.
const ROOM: f64 = 1.08;
/// Distance of the camera over the height that it sees: half over the tangent of half of 45 degrees.
const DISTANCE_PER_HEIGHT: f64 = 1.2;
/// Width over height of the picture, beside an open side bar.
const ASPECT: f64 = 1.35;
/// Width of a character of a legend, and of what stands beside its text [pixels], as Lichtblick 1.28 draws them.
const CHARACTER: usize = 8;
const BESIDE: usize = 66;
/// Size of the marks of impacts [pixels].
const MARK: f64 = 2.0;

/// The layout as JSON.
pub fn layout(header: &Header) -> Result<String> {
    let mut layout: Value = serde_json::from_str(TEMPLATE)?;
    // More curves than colours are there to be switched on.
    let curve = |value: String, label: String, place: usize| {
        let (color, enabled) = (hex(CURVE_COLOURS[place % CURVE_COLOURS.len()]), place < CURVE_COLOURS.len());
        json!({ "value": value, "label": label, "enabled": enabled, "timestampMethod": "receiveTime", "color": color })
    };
    let bodies: Vec<(usize, &BodyInfo)> = header.bodies.iter().enumerate().filter(|(_, b)| is_touched(b)).collect();
    let of_bodies = |value: &dyn Fn(usize) -> String| {
        let all = bodies.iter().enumerate();
        all.map(|(place, (i, body))| curve(value(*i), short_name(body), place)).collect::<Vec<Value>>()
    };
    let contact = of_bodies(&|i| format!("/pitchline/signals.contact_force_max_n[{i}]"));
    let mut impacts = of_bodies(&|i| format!("/pitchline/impact{{body=={i}}}.peak_force_n"));
    for path in &mut impacts {
        (path["showLine"], path["lineSize"]) = (json!(false), json!(MARK));
    }
    // Sprockets on one shaft have one speed.
    let mut shafts = Vec::new();
    let mut speed = Vec::new();
    for (place, (_, body)) in bodies.iter().enumerate().filter(|(_, (_, body))| body.teeth > 0) {
        let Some(i) = body.coordinate.filter(|i| !shafts.contains(i)) else { continue };
        shafts.push(i);
        speed.push(curve(format!("/pitchline/signals.rotor_speed_rpm[{i}]"), short_name(body), place));
    }
    for (panel, paths) in [("Plot!contact", contact), ("Plot!impacts", impacts), ("Plot!speed", speed)] {
        let longest = paths.iter().filter_map(|p| p["label"].as_str()).map(|label| label.chars().count()).max();
        let config = layout.pointer_mut(&format!("/configById/{panel}")).context("the template has this panel")?;
        config["sidebarDimension"] = json!(BESIDE + CHARACTER * longest.unwrap_or(0));
        config["paths"] = json!(paths);
    }
    let (mut low, high) = scene_bounds(header);
    low[1] = ForceArrows::new(header).legend_ends_at(low[1]);
    if low[0] <= high[0] {
        let camera = layout.pointer_mut("/configById/3D!drive/cameraState").context("the template has a camera")?;
        let size = [0, 1].map(|k| high[k] - low[k]);
        camera["distance"] = json!(ROOM * DISTANCE_PER_HEIGHT * size[1].max(size[0] / ASPECT));
        camera["targetOffset"] = json!([0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), 0.0]);
    }
    Ok(format!("{layout:#}\n"))
}

/// Whether chains touch a body.
fn is_touched(body: &BodyInfo) -> bool {
    body.teeth > 0 || body.path.contains("guides.")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_have_the_names_of_their_bodies() {
        let body = |path: &str, teeth| BodyInfo {
            path: path.into(),
            teeth,
            coordinate: (teeth > 0).then_some(0),
            ..BodyInfo::default()
        };
        let header = Header {
            bodies: vec![body("sprockets.driver", 20), body("guides.fixed.tight", 0), body("housings.bore", 0)],
            coordinates: vec!["sprockets.driver".into()],
            ..Header::default()
        };
        let layout: Value = serde_json::from_str(&layout(&header).unwrap()).unwrap();
        let paths = |panel: &str| layout["configById"][panel]["paths"].as_array().unwrap().clone();
        let labels: Vec<Value> = paths("Plot!contact").iter().map(|p| p["label"].clone()).collect();
        assert_eq!(labels, ["driver", "tight"]);
        assert_eq!(paths("Plot!impacts")[1]["value"], "/pitchline/impact{body==1}.peak_force_n");
        assert_eq!(paths("Plot!contact")[1]["color"], paths("Plot!impacts")[1]["color"]);
        assert_eq!(paths("Plot!speed")[0]["value"], "/pitchline/signals.rotor_speed_rpm[0]");
    }
}
