//! Any text is a break expression or a report with a caret; never a panic. What parses is evaluated on a frame.
//!
//! cargo install cargo-fuzz; RUSTC_BOOTSTRAP=1 cargo fuzz run breakpoint -- -max_total_time=600
#![no_main]

use libfuzzer_sys::fuzz_target;
use pitchline::breakpoint::{Breakpoint, Names};
use pitchline::recording::columns::Rows;
use pitchline::recording::frame::Frame;

fuzz_target!(|text: &str| {
    let names = Names {
        bodies: vec!["sprockets.driver".into(), "sprockets.driven".into(), "guides.fixed.tight".into()],
        turning: vec![("sprockets.driver".into(), 0), ("sprockets.driven".into(), 1), ("arms.tensioner".into(), 2)],
        rows: vec![
            (Rows::Slider, vec!["sliders.plunger".into(), "passages.check.feed".into()]),
            (Rows::Touch, vec!["sliders.plunger.tip".into()]),
            (Rows::Chamber, vec!["chambers.high".into(), "reservoirs.sump".into()]),
            (Rows::Passage, vec!["passages.check.feed".into()]),
        ],
        chains: vec![90],
    };
    match Breakpoint::parse(text, &names) {
        Ok(breakpoint) => {
            let mut frame = Frame::default();
            frame.links.x_m = vec![0.5; 3];
            frame.joints.force_x_n = vec![1.0; 3];
            frame.joints.force_y_n = vec![1.0; 3];
            let _held = breakpoint.holding(&frame);
        }
        Err(report) => assert!(!report.to_string().is_empty()),
    }
});
