//! What the loop finds in records of a drive with links that has one effect its file does not declare: a row for each.
//!
//! `cargo bench --bench links [-- WORD]` runs all cases, or those whose name holds the word.

#[path = "../tests/links/mod.rs"]
mod links;

#[path = "../tests/links/engines.rs"]
mod engines;

fn main() {
    let word = std::env::args().skip(1).find(|a| !a.starts_with('-'));
    println!(
        "{:<22} {:<10} {:<34} {:>8} {:>8} {:>6} {:>6}  rivals",
        "truth", "outcome", "named", "before", "after", "s", "runs"
    );
    let one_chain = links::CASES.iter().map(|c| (links::one_chain(links::bush(), c), c));
    let reductions = links::REDUCTION_CASES.iter().map(|c| (links::reduction(), c));
    let engines = engines::ENGINE_CASES.iter().map(|c| (engines::engine(c), c));
    let tensioners = links::TENSIONER_CASES.iter().map(|c| (links::tensioner(), c));
    let all = one_chain.chain(reductions).chain(tensioners).chain(engines);
    for (rig, case) in all.filter(|(_, c)| word.as_ref().is_none_or(|w| c.name.contains(w.as_str()))) {
        let folder = tempfile::tempdir().expect("a folder");
        let folder = match std::env::var_os("PITCHLINE_KEEP") {
            Some(kept) => kept.into(),
            None => folder.path().to_path_buf(),
        };
        links::write(&folder, &rig, case, 11);
        let started = std::time::Instant::now();
        let r = match links::identified(&folder, 2) {
            Ok(r) => r,
            Err(e) => {
                println!("{:<22} {e}", case.name);
                continue;
            }
        };
        let error = |all: &[pitchline::identify::report::ChannelError]| {
            let own: Vec<f64> = all.iter().filter(|e| e.record.is_none()).filter_map(|e| e.held_out).collect();
            own.iter().map(|e| e.ln()).sum::<f64>() / own.len().max(1) as f64
        };
        let (before, after) = (error(&r.error_before), error(&r.error_after));
        let floor = r.noise_floor.iter().map(|f| f.noise_floor.ln()).sum::<f64>() / r.noise_floor.len() as f64;
        if std::env::var_os("PITCHLINE_VERBOSE").is_some() {
            for (b, a) in r.error_before.iter().zip(&r.error_after) {
                println!(
                    "  {} {:?}: before {:?} {:?} after {:?} {:?}",
                    b.channel, b.record, b.fit, b.held_out, a.fit, a.held_out
                );
            }
            for f in &r.noise_floor {
                println!(
                    "  floor {}: {:.4} {}, lag 1 {:.3}, white {}",
                    f.channel, f.noise_floor, f.unit, f.lag1, f.white
                );
            }
            for c in r.candidates.iter().filter(|c| c.rms_fit.is_some() || c.promised > 0.001) {
                println!(
                    "  {} beside {:?}: promised {:.4}, score {:?}: {}",
                    c.identity, c.beside, c.promised, c.score, c.why
                );
            }
        }
        let named: Vec<String> = r
            .effects
            .iter()
            .map(|e| {
                let numbers: Vec<String> = e.parameters.iter().map(|p| format!("{:.3}", p.value)).collect();
                format!("{} {}", e.path.trim_start_matches("effects."), numbers.join(" "))
            })
            .collect();
        let rivals: Vec<&str> = r.effects.iter().flat_map(|e| e.rivals.iter().map(|r| r.path.as_str())).collect();
        println!(
            "{:<22} {:<10} {:<34} {:8.3} {:8.3} {:6.0} {:6}  {}{}",
            case.name,
            format!("{:?}", r.outcome),
            named.join("; "),
            (before - floor).exp(),
            (after - floor).exp(),
            started.elapsed().as_secs_f64(),
            r.model_runs,
            rivals.join(" "),
            match (r.effects.first().map_or("", |e| e.path.as_str()) == case.path, r.explained) {
                (true, true) => "",
                (true, false) => " (not explained)",
                (false, _) => " WRONG",
            }
        );
    }
}
