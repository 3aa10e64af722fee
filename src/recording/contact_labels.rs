//! Names in viewers: what is written beside contacts, and a page of the largest contacts of an instant.

use super::frame::{BodyInfo, Feature, Frame, Header, Segment};
use std::fmt::Write;

/// Words beside a contact.
#[derive(Clone, Debug, PartialEq)]
pub struct ContactLabel {
    /// Where it touches [m].
    pub point_m: [f64; 2],
    pub text: String,
}

/// Force from which on a contact has a label, as a share of the mean static tension; and that of contacts that have just begun.
const LARGE: f64 = 0.5;
const LARGE_OF_YOUNG: f64 = 0.02;
/// How long a contact is young [tooth periods].
const YOUNG: f64 = 0.1;
/// Most labels of one picture.
const MOST_LABELS: usize = 16;
/// What each has for itself in a close-up, across and upright [pitches].
const ROOM: [f64; 2] = [1.3, 0.25];
/// Rows of the page of contacts.
const MOST_ROWS: usize = 12;
/// assumed: a force to compare with, for a drive that was assembled without tension [N]
const WITHOUT_TENSION_N: f64 = 100.0;

/// The force to which drawings relate others: the mean static tension [N].
pub fn reference_force_n(header: &Header) -> f64 {
    if header.static_tension_n > 0.0 { header.static_tension_n } else { WITHOUT_TENSION_N }
}

/// Last part of a body's path; in merged recordings with the name of the drive.
pub fn short_name(body: &BodyInfo) -> String {
    let last = crate::diag::last_name(&body.path);
    drive_of(body).map_or_else(|| last.to_string(), |drive| format!("{drive} {last}"))
}

/// Which drive of a merged recording a body belongs to; None: the recording is of one drive.
pub fn drive_of(body: &BodyInfo) -> Option<&str> {
    match body.path.split('.').next() {
        Some("sprockets" | "guides" | "arms" | "sliders" | "housings" | "passages" | "valves" | "cams" | "chains")
        | None => None,
        drive => drive,
    }
}

/// Names of the drives of a merged recording, in the order of their bodies.
pub fn drives_of(header: &Header) -> Vec<&str> {
    let mut drives = Vec::new();
    for drive in header.bodies.iter().filter_map(drive_of) {
        if !drives.contains(&drive) {
            drives.push(drive);
        }
    }
    drives
}

/// What a label has for itself in a close-up, across and upright [m].
pub fn close_up_room_m(header: &Header) -> [f64; 2] {
    ROOM.map(|pitches| pitches * header.links.first().map_or(0.0, |l| l.pitch_m))
}

/// Labels of the contacts of a frame that are large or have just begun, the largest first, where there is room for them.
pub fn contact_labels(frame: &Frame, header: &Header, room_m: [f64; 2]) -> Vec<ContactLabel> {
    let (c, links) = (&frame.contacts, &frame.links);
    let reference_n = reference_force_n(header);
    let Some(link) = header.links.first() else { return Vec::new() };
    let speed_m_s = links.vx_m_s.first().zip(links.vy_m_s.first()).map_or(0.0, |(x, y)| libm::hypot(*x, *y));
    let young_s = if speed_m_s > 0.0 { YOUNG * link.pitch_m / speed_m_s } else { 0.0 };
    let has_label = |i: &usize| {
        let least = if c.age_s[*i] < young_s { LARGE_OF_YOUNG } else { LARGE };
        c.normal_force_n[*i] >= least * reference_n
    };
    let mut wanted: Vec<usize> = (0..c.link.len()).filter(has_label).collect();
    wanted.sort_by(|a, b| c.normal_force_n[*b].total_cmp(&c.normal_force_n[*a]));
    let mut labels: Vec<ContactLabel> = Vec::new();
    for i in wanted {
        let point_m = [c.point_body_x_m[i], c.point_body_y_m[i]];
        let near = |l: &ContactLabel| (0..2).all(|k| (l.point_m[k] - point_m[k]).abs() < room_m[k]);
        if labels.iter().any(near) {
            continue;
        }
        let body = header.bodies.get(c.body[i] as usize);
        let place = match body {
            Some(b) if b.teeth > 0 => format!("gap {}", c.tooth[i]),
            Some(b) => crate::diag::last_name(&b.path).to_string(),
            None => String::new(),
        };
        let text = format!("link {}, {place}: {:.0} N", c.link[i], c.normal_force_n[i]);
        labels.push(ContactLabel { point_m, text });
        if labels.len() == MOST_LABELS {
            break;
        }
    }
    labels
}

/// The largest contacts of a frame as a table in Markdown, a row each, the largest force first.
pub fn contacts_page(frame: &Frame, header: &Header) -> String {
    let c = &frame.contacts;
    let mut order: Vec<usize> = (0..c.link.len()).collect();
    order.sort_by(|a, b| c.normal_force_n[*b].total_cmp(&c.normal_force_n[*a]));
    let mut page = String::with_capacity(96 * (3 + order.len().min(MOST_ROWS)));
    page += "| force N | link | its | on | gap | at | depth um | friction N | sliding m/s | age us |\n\
             |--:|--:|---|---|--:|---|--:|--:|--:|--:|\n";
    for i in order.iter().copied().take(MOST_ROWS) {
        let body = header.bodies.get(c.body[i] as usize);
        let gap = if body.is_some_and(|b| b.teeth > 0) { c.tooth[i].to_string() } else { String::new() };
        let _infallible = writeln!(
            page,
            "| {:.1} | {} | {} | {} | {gap} | {} | {:.2} | {:.1} | {:.2} | {:.0} |",
            c.normal_force_n[i],
            c.link[i],
            Feature::name(c.feature[i]),
            body.map_or_else(String::new, short_name),
            Segment::name(c.segment[i]),
            1e6 * c.penetration_m[i],
            c.tangential_force_n[i],
            c.tangential_speed_m_s[i],
            1e6 * c.age_s[i],
        );
    }
    if order.len() > MOST_ROWS {
        let _infallible = writeln!(page, "\n{} smaller ones are in `state/contacts`.", order.len() - MOST_ROWS);
    }
    page
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::frame::{Contacts, LinkInfo, Links};

    fn header() -> Header {
        let link = LinkInfo { outline: 0, pitch_m: 8e-3, mass_kg: 1e-3, inertia_kg_m2: 1e-8, ahead: 0 };
        let body = |path: &str, teeth| BodyInfo { path: path.into(), teeth, ..BodyInfo::default() };
        Header {
            links: vec![link; 3],
            bodies: vec![body("sprockets.driver", 20), body("guides.fixed.tight", 0)],
            static_tension_n: 100.0,
            ..Header::default()
        }
    }

    /// Contacts of given forces [N], places along x [m] and ages [s], on the sprocket first, then on the guide.
    fn frame(of: &[(f64, f64, f64)]) -> Frame {
        let n = of.len();
        let column = |value: fn(&(f64, f64, f64)) -> f64| of.iter().map(value).collect::<Vec<f64>>();
        let contacts = Contacts {
            link: (0..n as u32).collect(),
            feature: vec![0; n],
            body: (0..n as u32).map(|i| u32::from(i > 0)).collect(),
            tooth: vec![7; n],
            segment: vec![0; n],
            point_body_x_m: column(|c| c.1),
            point_body_y_m: vec![0.0; n],
            normal_force_n: column(|c| c.0),
            penetration_m: vec![1e-6; n],
            tangential_force_n: vec![-2.0; n],
            tangential_speed_m_s: vec![0.5; n],
            age_s: column(|c| c.2),
            ..Contacts::default()
        };
        let (vx_m_s, vy_m_s) = (vec![8.0; 3], vec![0.0; 3]);
        Frame { contacts, links: Links { vx_m_s, vy_m_s, ..Links::default() }, ..Frame::default() }
    }

    #[test]
    fn large_and_young_contacts_have_labels_where_there_is_room() {
        // The tooth period is 1 ms: the third is young, the fourth is neither, the second is beside a larger one.
        let f = frame(&[(540.0, 0.0, 1e-3), (200.0, 2e-3, 1e-3), (3.0, 20e-3, 5e-5), (30.0, 40e-3, 1e-3)]);
        let labels: Vec<String> =
            contact_labels(&f, &header(), close_up_room_m(&header())).into_iter().map(|l| l.text).collect();
        assert_eq!(labels, ["link 0, gap 7: 540 N", "link 2, tight: 3 N"]);
    }

    #[test]
    fn the_page_has_a_row_for_each_contact_the_largest_first() {
        let page = contacts_page(&frame(&[(5.0, 0.0, 1e-3), (200.0, 2e-3, 1e-3)]), &header());
        let rows: Vec<&str> = page.lines().skip(2).collect();
        assert_eq!(
            rows,
            [
                "| 200.0 | 1 | rear bush | tight |  | seat | 1.00 | -2.0 | 0.50 | 1000 |",
                "| 5.0 | 0 | rear bush | driver | 7 | seat | 1.00 | -2.0 | 0.50 | 1000 |"
            ]
        );
        let many: Vec<(f64, f64, f64)> = (0..30).map(|i| (f64::from(i), 0.0, 0.0)).collect();
        assert!(contacts_page(&frame(&many), &header()).contains("18 smaller ones are in `state/contacts`"));
    }
}
