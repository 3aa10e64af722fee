//! Output of `run --stats`: cost of contact detection for each pair.

use crate::integrate::explicit::CountedPair;

const LEGEND: &str = "  A query is one block of 8 ends in one step. Skipped: blocks whose gaps were known to be too wide for the step, without a query.
  Near: something touches or may within the step. Solved: forces were computed. Hits/8: ends with a force in a solved block. Searches: ends that face another element of the contour than before.";

/// A table with one line per pair, its share of the run time, and an explanation of its counts.
pub(super) fn text(pairs: &[CountedPair], wall_s: f64) -> String {
    let mut lines = vec![format!(
        "  {:<12} {:<18} {:>10} {:>10} {:>8} {:>8} {:>10} {:>7} {:>9} {:>9} {:>8}",
        "part", "body", "queries", "skipped", "near", "solved", "ends hit", "hits/8", "searches", "ns/query", "of time"
    )];
    for CountedPair { part, body, counts: c } in pairs {
        let of_queries = |n: u64| format!("{:.1} %", 100.0 * n as f64 / c.queries.max(1) as f64);
        lines.push(format!(
            "  {part:<12} {body:<18} {:>10} {:>10} {:>8} {:>8} {:>10} {:>7.2} {:>9} {:>9.1} {:>8}",
            c.queries,
            c.skipped,
            of_queries(c.near),
            of_queries(c.solved),
            c.hits,
            c.hits as f64 / c.solved.max(1) as f64,
            c.searches,
            1e9 * c.time_s / c.queries.max(1) as f64,
            format!("{:.1} %", 100.0 * c.time_s / wall_s),
        ));
    }
    lines.push(LEGEND.into());
    lines.join("\n") + "\n"
}

pub(super) fn json(pairs: &[CountedPair], wall_s: f64) -> serde_json::Value {
    let pair = |p: &CountedPair| {
        serde_json::json!({
            "part": p.part,
            "body": p.body,
            "queries": p.counts.queries,
            "skipped": p.counts.skipped,
            "near": p.counts.near,
            "solved": p.counts.solved,
            "hits": p.counts.hits,
            "searches": p.counts.searches,
            "time_s": p.counts.time_s,
            "share_of_time": p.counts.time_s / wall_s,
        })
    };
    pairs.iter().map(pair).collect()
}
