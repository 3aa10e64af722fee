//! The report as text.

use super::diagnosis::Diagnosis;
use super::report::{
    ChannelError, Correlation, FittedNumber, IdentificationReport, IdentificationVerdict, NamedEffect,
};
use std::fmt::Write;

/// Four significant digits.
pub(super) fn four_digits(x: f64) -> String {
    let size = x.abs();
    if x == 0.0 || !x.is_finite() {
        format!("{x}")
    } else if (1e-3..1e5).contains(&size) {
        let digits = (3.0 - libm::floor(libm::log10(size))).max(0.0) as usize;
        format!("{x:.digits$}")
    } else {
        format!("{x:.3e}")
    }
}

fn optional_number(x: Option<f64>) -> String {
    x.map_or("-".to_string(), four_digits)
}

/// The report as text for a terminal.
pub fn text(r: &IdentificationReport) -> String {
    let mut t = String::new();
    write_all(&mut t, r);
    t
}

fn verdict(r: &IdentificationReport) -> String {
    let named = |law: bool| {
        let names: Vec<String> = r
            .effects
            .iter()
            .map(|e| {
                let name =
                    if law && !e.rivals.is_empty() { format!("{} ({})", e.family, e.path) } else { e.path.clone() };
                name + &course(r, e)
            })
            .collect();
        names.join(", ")
    };
    match r.outcome {
        IdentificationVerdict::Named => format!("NAMED: {}", named(true)),
        IdentificationVerdict::Part => format!("PART, something else is left: {}", named(true)),
        IdentificationVerdict::Lead => format!("LEAD, not named: {}", named(true)),
        IdentificationVerdict::Ambiguous => format!("AMBIGUOUS: {}", named(false)),
        IdentificationVerdict::None if r.interrupted || r.budget_spent => {
            "NONE so far: the search ended before all effects were looked at".to_string()
        }
        IdentificationVerdict::None => "NONE: no effect of the catalogue explains the residual".to_string(),
    }
}

/// How the size of an effect goes in the order of the records, where it has one for each.
fn course(r: &IdentificationReport, e: &NamedEffect) -> String {
    let has_own = |path: &str| e.parameters.iter().any(|n| n.path == path && n.record.is_some());
    let varying = r.varying.first().filter(|v| has_own(&v.path));
    varying.map_or(String::new(), |v| format!(", which {}", v.course.label()))
}

fn write_all(t: &mut String, r: &IdentificationReport) {
    // Writing into a String never fails.
    let _infallible = (|| -> std::fmt::Result {
        writeln!(t, "{}", r.title)?;
        writeln!(t, "\n{}", verdict(r))?;
        writeln!(
            t,
            "{}",
            if r.explained && r.prediction.is_some() {
                "EXPLAINED, beside a force that nobody measures: what is left of predictions is white and at their floor"
            } else if r.explained {
                "EXPLAINED: what is left is white and at the noise floor"
            } else if r.prediction.is_some() {
                "NOT EXPLAINED: what is left is above the noise floor, or not white, or the force that nobody measures is too large"
            } else {
                "NOT EXPLAINED: what is left is above the noise floor, or not white"
            }
        )?;
        for first in &r.look_first {
            writeln!(t, "LOOK FIRST: {first}")?;
        }
        for doubt in &r.doubts {
            writeln!(t, "DOUBT: {doubt}")?;
        }
        if r.interrupted || r.budget_spent || !r.converged {
            let why = if r.interrupted {
                "interrupted"
            } else if r.budget_spent {
                "the budget was spent"
            } else {
                "a fit did not converge"
            };
            // A name that stands was found in time.
            let then =
                match matches!(r.outcome, IdentificationVerdict::Named | IdentificationVerdict::Part) && r.converged {
                    true => "what is said of the rest and of inverse dynamics may lack something",
                    false => "more effects may exist, and the result is less certain",
                };
            writeln!(t, "PARTIAL: {why}; {then}")?;
        }
        falls(t, r)?;
        records(t, r)?;
        errors(t, r)?;
        prediction(t, r)?;
        effects(t, r)?;
        declared_numbers(t, r)?;
        basins(t, r)?;
        varying(t, r)?;
        inverse_dynamics(t, r)?;
        for w in &r.warnings {
            writeln!(t, "warning: {w}")?;
        }
        push_remaining_sections(t, r)
    })();
}

/// How far the effects take the error of the channel that is left farthest above its floor, in words.
fn falls(t: &mut String, r: &IdentificationReport) -> std::fmt::Result {
    if r.effects.is_empty() {
        return Ok(());
    }
    let Some(floor) = r.noise_floor.iter().max_by(|a, b| a.times_floor.total_cmp(&b.times_floor)) else {
        return Ok(());
    };
    let of_channel = |all: &[ChannelError]| {
        let own = all.iter().find(|e| e.channel == floor.channel && e.record.is_none())?;
        own.held_out.or(own.fit)
    };
    match (of_channel(&r.error_before), of_channel(&r.error_after)) {
        (Some(before), Some(after)) => writeln!(
            t,
            "with this, the error of `{}` falls from {} to {} {}, {:.2} times its noise floor",
            floor.channel,
            four_digits(before),
            four_digits(after),
            floor.unit,
            floor.times_floor
        ),
        _ => Ok(()),
    }
}

/// The records, and what they are told apart by.
fn records(t: &mut String, r: &IdentificationReport) -> std::fmt::Result {
    writeln!(t)?;
    for c in &r.clocks {
        writeln!(
            t,
            "  record {:<14} {:>8} samples, {} 1/s, {:.4} s{}",
            c.record,
            c.samples,
            four_digits(c.rate_hz),
            c.length_s,
            if c.gaps > 0 { format!(", {} gaps", c.gaps) } else { String::new() }
        )?;
    }
    for w in &r.wheels {
        writeln!(t, "  {}", w.to_string().replace('\n', "\n  "))?;
    }
    writeln!(t, "  held-out samples {}, drive {}", r.held_out_hash, r.drive_hash)
}

/// Starts of the reported set, and where they ended.
fn basins(t: &mut String, r: &IdentificationReport) -> std::fmt::Result {
    let Some((own, others)) = r.basins.split_first() else { return Ok(()) };
    writeln!(t, "\nfits from {} end at these numbers", own.starts.join(", "))?;
    for basin in others {
        let numbers = basin.numbers.iter().map(|(path, value, _)| format!("{path} = {}", four_digits(*value)));
        let numbers: Vec<String> = numbers.collect();
        let how = if basin.above < 0.0 { "less" } else { "more" };
        writeln!(
            t,
            "    from {} in another basin, whose misfit is {:.1} {how}: {}",
            basin.starts.join(", "),
            basin.above.abs(),
            numbers.join(", ")
        )?;
    }
    Ok(())
}

/// Where prediction decided: what of the motion was corrected, the simulated errors, and what stands by one way alone.
fn prediction(t: &mut String, r: &IdentificationReport) -> std::fmt::Result {
    let Some(p) = &r.prediction else { return Ok(()) };
    writeln!(
        t,
        "\nprediction: a simulation adds up what nobody measures, so each sample corrects the state by {:.1} % of the difference (forgotten in {} s)",
        100.0 * p.share,
        four_digits(p.memory_s)
    )?;
    for force in &p.unmeasured {
        writeln!(
            t,
            "    as for a force on {} that differs by {} {} from sample to sample{}",
            force.body,
            four_digits(force.size),
            force.unit,
            match force.noise_of_inputs > 0.0 {
                true => format!("; what is measured shows a noise of {}", four_digits(force.noise_of_inputs)),
                false => String::new(),
            }
        )?;
    }
    for e in p.simulated.iter().filter(|e| e.record.is_none()) {
        writeln!(
            t,
            "    simulated, the set that a simulation finds errs by {} {} in {}",
            optional_number(e.held_out.or(e.fit)),
            e.unit,
            e.channel
        )?;
    }
    for (paths, way) in [(&p.by_prediction_alone, "prediction"), (&p.by_simulation_alone, "simulation")] {
        for path in paths {
            writeln!(t, "    {path} stands by {way} alone")?;
        }
    }
    Ok(())
}

fn errors(t: &mut String, r: &IdentificationReport) -> std::fmt::Result {
    writeln!(
        t,
        "\nchannel            record         unit        floor  held out before -> after            ratio  x floor  white"
    )?;
    for (b, a) in r.error_before.iter().zip(&r.error_after) {
        let floor = r.noise_floor.iter().find(|f| f.channel == b.channel);
        let interval =
            a.held_out_interval.map_or(String::new(), |[l, h]| format!("[{}, {}]", four_digits(l), four_digits(h)));
        let ratio = match (b.held_out, a.held_out) {
            (Some(b), Some(a)) if b > 0.0 => format!("{:.3}", a / b),
            _ => "-".into(),
        };
        // A record that is only fitted has no held-out samples: its fit error is shown instead and marked.
        let only_fits = b.held_out.is_none();
        let (before, after) = if only_fits { (b.fit, a.fit) } else { (b.held_out, a.held_out) };
        let interval = if only_fits { "(fitted)".to_string() } else { interval };
        let (floor_value, white) = match (&b.record, floor) {
            (None, Some(f)) => (four_digits(f.noise_floor), if f.white { "yes" } else { "no" }),
            _ => (String::new(), ""),
        };
        let times = match (&b.record, floor) {
            (None, Some(f)) => format!("{:.2}", f.times_floor),
            _ => String::new(),
        };
        writeln!(
            t,
            "{:<18} {:<14} {:<9} {:>7}  {:>8} -> {:<8} {:<20} {:>6}  {:>7}  {}",
            b.channel,
            b.record.as_deref().unwrap_or("all"),
            b.unit,
            floor_value,
            optional_number(before),
            optional_number(after),
            interval,
            ratio,
            times,
            white
        )?;
    }
    Ok(())
}

fn number(n: &FittedNumber) -> String {
    let key = n.path.rsplit('.').next().unwrap_or(&n.path);
    let of = n.record.as_ref().map_or(String::new(), |r| format!(" in {r}"));
    if !n.determined {
        format!("{key}{of}: not determined by the fitted data")
    } else if n.standard_error > 0.0 {
        format!("{key}{of} = {} +- {}", four_digits(n.value), four_digits(n.standard_error))
    } else if n.tried {
        format!("{key}{of} = {} (tried, not fitted)", four_digits(n.value))
    } else {
        format!("{key}{of} = {}", four_digits(n.value))
    }
}

fn effects(t: &mut String, r: &IdentificationReport) -> std::fmt::Result {
    each_effect(t, r)?;
    for pair in &r.by_direction {
        let [friction, load] = &pair.effects;
        writeln!(
            t,
            "\n`{friction}` and `{load}` together are as well friction of {} {unit} forwards and {} {unit} backwards: only a body at rest would tell",
            four_digits(pair.forwards),
            four_digits(pair.backwards),
            unit = pair.unit
        )?;
    }
    Ok(())
}

fn each_effect(t: &mut String, r: &IdentificationReport) -> std::fmt::Result {
    for (i, e) in r.effects.iter().enumerate() {
        let row = crate::effects::named(&e.name);
        writeln!(t, "\neffect {}: {}  {}", i + 1, e.path, row.map_or("", |r| r.title))?;
        for n in &e.parameters {
            writeln!(t, "    {}", number(n))?;
        }
        writeln!(
            t,
            "    held-out error with it / without it {:.3} [{:.3}, {:.3}]; takes {:.1} % of the squared error, a sham {:.2} %",
            e.judge_ratio[0],
            e.judge_ratio[1],
            e.judge_ratio[2],
            100.0 * e.gain,
            100.0 * e.sham_gain
        )?;
        if !e.sizes.is_empty() {
            writeln!(
                t,
                "    its size in halves of records, over that in all: {}",
                super::steady::sizes_text(&e.sizes)
            )?;
        }
        if !e.judged_by_leaving_out.is_empty() {
            let records = e.judged_by_leaving_out.join(", ");
            writeln!(t, "    the held-out data do not show it: tested on {records}, each left out of the fit in turn")?;
        }
        for path in &e.by_order {
            writeln!(
                t,
                "    cannot be separated from {path} by order: the teeth divide the links, so that one always meets the same other"
            )?;
        }
        for rival in e.rivals.iter().filter(|r| !e.by_order.contains(&r.path)) {
            writeln!(
                t,
                "    cannot be told from {} (held-out error {:.3} times [{:.3}, {:.3}])",
                rival.identity, rival.judge_ratio[0], rival.judge_ratio[1], rival.judge_ratio[2]
            )?;
        }
    }
    if let Some(u) = &r.unnamed {
        writeln!(t, "\nUNNAMED force on {}: {}", u.body, u.formula)?;
        writeln!(
            t,
            "    held-out error with it / without it {:.3} [{:.3}, {:.3}]; q and v are angle or position and speed; no physical name is implied",
            u.judge_ratio[0], u.judge_ratio[1], u.judge_ratio[2]
        )?;
    }
    Ok(())
}

fn declared_numbers(t: &mut String, r: &IdentificationReport) -> std::fmt::Result {
    if r.numbers_before.is_empty() {
        return Ok(());
    }
    writeln!(t, "\ndeclared number                                     in file     before      after")?;
    for (b, a) in r.numbers_before.iter().zip(&r.numbers_after) {
        writeln!(
            t,
            "{:<50} {:>9}  {:>9}  {:>9} +- {}{}",
            match &b.record {
                Some(record) => format!("{} ({record})", b.path),
                None => b.path.clone(),
            },
            optional_number(b.nameplate),
            four_digits(b.value),
            four_digits(a.value),
            four_digits(a.standard_error),
            if a.at_bound { "  AT ITS BOUND" } else { "" }
        )?;
    }
    for Correlation { of: [a, b], coefficient } in &r.correlations {
        writeln!(
            t,
            "these records know a combination of `{a}` and `{b}` far better than each of them: correlation {coefficient:.3}"
        )?;
    }
    Ok(())
}

/// Writes the numbers that differ from record to record.
fn varying(t: &mut String, r: &IdentificationReport) -> std::fmt::Result {
    for (i, v) in r.varying.iter().enumerate() {
        let also = if i == 0 { "" } else { "or: " };
        let unnamed = |id: &&String| !r.effects.iter().any(|e| id.starts_with(&e.path));
        let unnamed: Vec<&str> = v.beside.iter().filter(unnamed).map(String::as_str).collect();
        let beside =
            if unnamed.is_empty() { String::new() } else { format!(", if the machine has {}", unnamed.join(" and ")) };
        writeln!(t, "\n{also}`{}` {}{beside}", v.path, v.course.label())?;
        for n in &v.values {
            writeln!(t, "    {:<18} {:>10} +- {}", n.record, four_digits(n.value), four_digits(n.standard_error))?;
        }
        let held_out = v.held_out_ratio.map_or(String::new(), |[ratio, low, high]| {
            format!("; held-out records, with values between those of their neighbours, {ratio:.3} [{low:.3}, {high:.3}] times")
        });
        writeln!(
            t,
            "    with a value for each record the fitted error is {:.3} times that with one for all{held_out}",
            v.fitted_ratio
        )?;
    }
    Ok(())
}

/// Writes the numbers by inverse dynamics beside those of the simulation.
fn inverse_dynamics(t: &mut String, r: &IdentificationReport) -> std::fmt::Result {
    let Some(inverse) = &r.inverse_dynamics else { return Ok(()) };
    writeln!(
        t,
        "\ninverse dynamics: the measured motion, smoothed over {} s, needs the measured force but for {:.2} % of it",
        four_digits(inverse.smoother_s),
        100.0 * inverse.error_share
    )?;
    for n in &inverse.numbers {
        writeln!(
            t,
            "    {:<50} simulated {:>9}, by inverse dynamics {:>9} +- {}",
            n.path,
            four_digits(n.simulated),
            four_digits(n.inverse),
            four_digits(n.standard_error)
        )?;
    }
    Ok(())
}

/// Writes the residual analysis; channels without any line are left out.
fn diagnosis(t: &mut String, d: &Diagnosis, title: &str) -> std::fmt::Result {
    let mut lines: Vec<String> = Vec::new();
    for c in &d.channels {
        let mut all: Vec<String> = Vec::new();
        for o in &c.orders {
            let speed = o.speed_exponent.map_or(String::new(), |e| format!(" (amplitude as speed^{e:.1})"));
            all.push(format!("{} {:.0} %{speed}", o.name, 100.0 * o.share));
        }
        let short = |path: &str| path.rsplit('.').next().unwrap_or(path).to_string();
        all.extend(c.states.iter().map(|s| format!("{} of {} {:.0} %", s.term, short(&s.body), 100.0 * s.share)));
        if !all.is_empty() {
            lines.push(format!("{:<14} {}", c.channel, all.join("; ")));
        }
    }
    let forces = d.forces.iter().map(|f| format!("{} on {} {:.0} %", f.term, f.body, 100.0 * f.share));
    let forces: Vec<String> = forces.collect();
    if !forces.is_empty() {
        lines.push(format!("{:<14} {}", "as a force", forces.join("; ")));
    }
    if !lines.is_empty() {
        writeln!(t, "\n{title} (shares of the squared error that one form takes; forms share)")?;
    }
    lines.iter().try_for_each(|l| writeln!(t, "    {l}"))
}

fn push_remaining_sections(t: &mut String, r: &IdentificationReport) -> std::fmt::Result {
    diagnosis(t, &r.diagnosis, "what the declared model leaves, by itself")?;
    if let Some(after) = &r.diagnosis_after {
        diagnosis(t, after, "what is left with the effects, by itself")?;
    }
    writeln!(t, "\nerror budget (squared error of the declared model)")?;
    for s in &r.error_budget {
        writeln!(t, "    {:>5.1} %  {}", s.percent, s.of)?;
    }
    if !r.transfer.is_empty() {
        writeln!(t, "\ntransfer to records of which nothing was used")?;
        for x in &r.transfer {
            writeln!(
                t,
                "    {:<14} {:<14} {} -> {} {} of a signal of {}: {}",
                x.record,
                x.channel,
                four_digits(x.error_before),
                four_digits(x.error),
                x.unit,
                four_digits(x.signal),
                if x.refused { "REFUSED, another plant or another state of it" } else { "holds" }
            )?;
        }
    }
    if !r.collisions.is_empty() {
        writeln!(t, "\nwhat teeth and links leave open")?;
        for c in &r.collisions {
            writeln!(t, "    {}", c.says)?;
        }
    }
    let mut lost: Vec<_> = r.candidates.iter().filter(|c| c.rms_fit.is_some() && c.why != "accepted").collect();
    lost.sort_by(|a, b| a.score.unwrap_or(f64::MAX).total_cmp(&b.score.unwrap_or(f64::MAX)));
    lost.dedup_by(|a, b| a.identity == b.identity);
    if !lost.is_empty() {
        writeln!(t, "\nfitted, and not taken (of {} looked at; all with --json)", r.candidates.len())?;
        let mut shown: Vec<&str> = Vec::new();
        for c in lost {
            if shown.len() < 8 && !shown.contains(&c.identity.as_str()) {
                shown.push(&c.identity);
                writeln!(t, "    {:<44} {}", c.identity, c.why)?;
            }
        }
    }
    for e in &r.next_experiment {
        writeln!(t, "\nnext experiment: {e}")?;
    }
    writeln!(t, "\n{} model runs", r.model_runs)
}
