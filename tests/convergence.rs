//! Order of convergence and accuracy of the scheme, measured against itself at a much finer step.

mod common;

use common::{EngagementWatch, assembled, drive_without_guides, for_step, watch};
use pitchline::model::Model;
use pitchline::recording::capture::contacts_at;
use pitchline::state::State;

/// Peaks of all engagements on the driver in a window, from a State that is the same for every step size.
fn peaks(model: &Model, start: &State, start_step_s: f64, step_s: f64, window_s: (f64, f64)) -> Vec<(u32, f64, f64)> {
    let mut model = model.clone();
    model.step_s = step_s;
    let mut state = for_step(start, start_step_s, step_s);
    let tooth_period_s = 8e-3 / model.chain_speed_m_s;
    let mut engagements = EngagementWatch::new(0, tooth_period_s, model.sprockets[0].body.law, step_s);
    let steps = (window_s.1 / step_s) as u64;
    let looking = model.clone();
    watch(&model, &mut state, steps, |state, scratch| {
        let t = state.step as f64 * step_s;
        if t >= window_s.0 {
            engagements.look(t, &contacts_at(&looking, state, scratch));
        }
    });
    // What was in contact when the window opened is no engagement.
    let begins = window_s.0 + 0.1 * tooth_period_s;
    engagements.done.iter().filter(|e| e.start_s > begins).map(|e| (e.link, e.start_s, e.peak)).collect()
}

/// Errors of one step size against the reference, over paired engagements.
#[derive(Default)]
struct Errors {
    max_percent: Vec<f64>,
    mean_percent: Vec<f64>,
}

fn compare(reference: &[(u32, f64, f64)], tried: &[(u32, f64, f64)], errors: &mut Errors) {
    let mut pairs = Vec::new();
    for (link, start, peak) in tried {
        // The same engagement starts within a third of a tooth period.
        if let Some((_, _, p)) = reference.iter().find(|(l, s, _)| l == link && (s - start).abs() < 3e-4) {
            pairs.push((*peak, *p));
        }
    }
    assert!(
        pairs.len() as f64 > 0.95 * reference.len() as f64,
        "{} of {} engagements pair",
        pairs.len(),
        reference.len()
    );
    let max = |f: &dyn Fn(&(f64, f64)) -> f64| pairs.iter().map(f).fold(0.0, f64::max);
    let sum = |f: &dyn Fn(&(f64, f64)) -> f64| pairs.iter().map(f).sum::<f64>();
    errors.max_percent.push(100.0 * (max(&|p| p.0) / max(&|p| p.1) - 1.0));
    errors.mean_percent.push(100.0 * (sum(&|p| p.0) / sum(&|p| p.1) - 1.0));
}

const REFERENCE_STEP_S: f64 = 0.25e-6;
/// Driver speeds whose tooth periods no step divides [rpm]: the seeds.
const SPEEDS_RPM: [f64; 4] = [3007.3, 3013.9, 3026.1, 3043.8];
/// Errors of largest and of mean engagement peak at the default step, mean over the seeds [%].
const PEAK_ERROR_PERCENT: f64 = 1.0;

#[test]
fn engagement_peaks_at_the_default_step_stay_within_one_percent_of_a_fine_step() {
    stay_within_one_percent("base", &[]);
}

#[test]
fn so_they_do_with_contact_damping_of_600_n_s_per_m() {
    stay_within_one_percent("contact damping 600 N s/m", &["contact.sprocket.linear.damping_n_s_per_m=600"]);
}

#[test]
fn so_they_do_with_pin_damping_of_300_n_s_per_m() {
    stay_within_one_percent("pin damping 300 N s/m", &["chain.joint.damping_n_s_per_m=300"]);
}

fn stay_within_one_percent(name: &str, overrides: &[&str]) {
    let factors: &[f64] =
        if std::env::var_os("PITCHLINE_SCHEME_TABLE").is_some() { &[0.7, 1.0, 1.2, 1.4, 1.7] } else { &[1.0] };
    println!(
        "error of the engagement peaks on the driver against {} us, mean over seeds [least, most]",
        REFERENCE_STEP_S * 1e6
    );
    println!("{:<28} {:>8} {:>26} {:>26}", "case", "step us", "max %", "mean %");
    let mut table: Vec<(f64, Errors)> = Vec::new();
    for rpm in SPEEDS_RPM {
        let speed = format!("speeds.constant.driver.speed_rpm={rpm}");
        let mut all = overrides.to_vec();
        all.push(&speed);
        let a = assembled(&drive_without_guides(&all));
        let default = a.report.step_s;
        let window = (5e-3, 90e-3);
        let reference = peaks(&a.model, &a.state, default, REFERENCE_STEP_S, window);
        for (i, factor) in factors.iter().enumerate() {
            let step = default * factor;
            let tried = peaks(&a.model, &a.state, default, step, window);
            if table.len() <= i {
                table.push((step, Errors::default()));
            }
            compare(&reference, &tried, &mut table[i].1);
        }
    }
    for (i, (step, e)) in table.iter().enumerate() {
        let show = |v: &[f64]| {
            let mean = v.iter().sum::<f64>() / v.len() as f64;
            let (low, high) = v.iter().fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(*x), h.max(*x)));
            (mean, format!("{mean:+.2} [{low:+.2}, {high:+.2}]"))
        };
        let ((max, max_text), (mean, mean_text)) = (show(&e.max_percent), show(&e.mean_percent));
        println!("{name:<28} {:>8.3} {max_text:>26} {mean_text:>26}", step * 1e6);
        let holds = factors[i] != 1.0 || (max.abs() <= PEAK_ERROR_PERCENT && mean.abs() <= PEAK_ERROR_PERCENT);
        assert!(holds, "{name}: above {PEAK_ERROR_PERCENT} %");
    }
}
