//! Placement of numbers without overlap: each takes the position of lowest cost among its candidates.

/// Width of a letter relative to the font size; for sans-serif fonts it lies between 0.5 and 0.62.
const LETTER: f64 = 0.58;
/// Height of a line relative to the font size.
const LINE: f64 = 1.15;

/// An axis-aligned box on the page: centre and half its sides [user units].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rect {
    pub centre: [f64; 2],
    pub half: [f64; 2],
}

impl Rect {
    /// Box of lines of text around `centre`.
    pub fn around_text(lines: &[String], size: f64, centre: [f64; 2]) -> Rect {
        let letters = lines.iter().map(|l| l.chars().count()).max().unwrap_or(0) as f64;
        Rect { centre, half: [0.5 * LETTER * size * letters, 0.5 * LINE * size * lines.len() as f64] }
    }

    pub fn overlaps(&self, other: &Rect) -> bool {
        (0..2).all(|k| (self.centre[k] - other.centre[k]).abs() < self.half[k] + other.half[k])
    }

    pub fn is_inside(&self, outer: &Rect) -> bool {
        (0..2).all(|k| (self.centre[k] - outer.centre[k]).abs() + self.half[k] <= outer.half[k])
    }

    /// Whether the straight line from `a` to `b` intersects the box.
    pub fn intersects(&self, [a, b]: [[f64; 2]; 2]) -> bool {
        let (mut from, mut to) = (0.0_f64, 1.0_f64);
        for k in 0..2 {
            let (start, run) = (a[k] - self.centre[k], b[k] - a[k]);
            if run == 0.0 {
                if start.abs() > self.half[k] {
                    return false;
                }
                continue;
            }
            let (s, t) = ((-self.half[k] - start) / run, (self.half[k] - start) / run);
            (from, to) = (from.max(s.min(t)), to.min(s.max(t)));
        }
        from <= to
    }
}

/// Occupied places of a panel.
#[derive(Clone, Debug, PartialEq)]
pub struct OccupiedPlaces {
    pub panel: Rect,
    /// Texts, which must not be covered.
    pub boxes: Vec<Rect>,
    /// Shafts of arrows, which should not be covered.
    pub strokes: Vec<[[f64; 2]; 2]>,
}

/// Takes this place if it is free.
pub fn take_place(taken: &mut OccupiedPlaces, place: Rect) -> bool {
    let free = place.is_inside(&taken.panel) && !taken.boxes.iter().any(|b| b.overlaps(&place));
    if free {
        taken.boxes.push(place);
    }
    free
}

/// Takes the place of lowest cost for a box of the size of `like` near the line from `tail` to `tip`: beyond the tip
/// first, then beside it, then further away. None if there is no room.
pub fn take_place_beside(taken: &mut OccupiedPlaces, like: Rect, [tail, tip]: [[f64; 2]; 2]) -> Option<Rect> {
    /// Cost of covering a shaft, in steps of distance.
    const SHAFT: f64 = 2.5;
    let along = libm::atan2(tip[1] - tail[1], tip[0] - tail[0]);
    let mut best: Option<(f64, Rect)> = None;
    for distance in 0..5 {
        for turn in 0..16 {
            // Alternating to both sides: 0, +22.5, -22.5, +45 degrees, ...
            let side = f64::from((turn + 1) / 2) * if turn % 2 == 0 { -1.0 } else { 1.0 };
            let (s, c) = crate::units::sin_cos(along + side * std::f64::consts::PI / 8.0);
            // The box touches a circle around the tip from outside.
            let radius = 3.0 + 9.0 * f64::from(distance);
            let reach = radius + (like.half[0] * c.abs() + like.half[1] * s.abs());
            let place = Rect { centre: [tip[0] + reach * c, tip[1] + reach * s], half: like.half };
            if !place.is_inside(&taken.panel) || taken.boxes.iter().any(|b| b.overlaps(&place)) {
                continue;
            }
            let shafts = taken.strokes.iter().filter(|shaft| place.intersects(**shaft)).count();
            let cost = f64::from(distance) + 0.12 * side.abs() + SHAFT * shafts as f64;
            if best.is_none_or(|(lowest, _)| cost < lowest) {
                best = Some((cost, place));
            }
        }
    }
    let (_, place) = best?;
    taken.boxes.push(place);
    Some(place)
}
