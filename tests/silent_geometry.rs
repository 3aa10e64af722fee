//! Silent chain: the closed forms of link and tooth, the way to the seat, the forces of a light wrap.

use pitchline::geometry::chain::silent::*;
use pitchline::geometry::silent_mesh::*;
use pitchline::geometry::silent_sprocket::*;
#[test]
fn probe() {
    for (p, z) in [(8.0, 20), (8.0, 40), (9.525, 28), (9.525, 18)] {
        let l = SilentLinkContour::new(SilentLinkForm::standard(p * 1e-3), p * 1e-3, p * 1e-3).unwrap();
        for face in [ToothFace::Arc, ToothFace::Line] {
            let s = SilentSprocket::new(SilentSprocketSpec::standard(z, p * 1e-3, face)).unwrap();
            s.profile().unwrap();
            println!("{p} {z} {face:?} toe {}", s.toe_clearance_m * 1e6);
            let t = std::time::Instant::now();
            let c = entry_clearances(&l, &s, 720);
            println!("{:?} {:#?}", t.elapsed(), c);
            println!("{:?}", wrap_statics(&s));
            println!("{:?}", flank_gaps_m(&l, &s, pitchline::geometry::Vec2::new(s.pitch_radius_m, 0.0), 0.0));
        }
    }
}
