//! The blind test of `identify`: machines made at random by code of their own, with one effect, two, none, or one outside the
//! catalogue; the table of how many were named right. `cargo bench --bench blind -- 200 150 60 40 50` takes so many of each class
//! (single, clean, outside, confusable, double); fewer are a quick look, `--from=K` leaves out the first of each. `-- write single 42 DIR` puts a case into files.

#[path = "../tests/blind/mod.rs"]
mod blind;
#[path = "../tests/blind/judge.rs"]
mod judge;

use blind::Class;

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    if let [what, class, number, folder] = args.as_slice()
        && what == "write"
    {
        write(class, number, std::path::Path::new(folder)).expect("written");
        return;
    }
    let counts: Vec<u64> = args.iter().filter_map(|a| a.parse().ok()).collect();
    let count = |i: usize, usual: u64| counts.get(i).copied().unwrap_or(usual);
    let classes = [
        (Class::Single, count(0, 200)),
        (Class::Clean, count(1, 150)),
        (Class::Outside, count(2, 60)),
        (Class::Confusable, count(3, 40)),
        (Class::Double, count(4, 50)),
    ];
    let started = std::time::Instant::now();
    let mut table = judge::Table::default();
    let verbose = args.iter().any(|a| a == "--verbose");
    let from = args.iter().find_map(|a| a.strip_prefix("--from=")?.parse().ok()).unwrap_or(0);
    for (class, n) in classes {
        let told = |o: &judge::Outcome| {
            if verbose {
                println!("{:.0} s {}", o.wall_s, o.line);
            }
        };
        let outcomes = judge::outcomes(class, from.min(n)..n, told);
        outcomes.iter().for_each(|o| table.add(o));
    }
    println!("{table}");
    let (first, in_set, _) = table.shares(Class::Single);
    println!("single, clear: first name right {:.1} %, set holds the truth {:.1} %", 100.0 * first, 100.0 * in_set);
    println!("{:.0} s", started.elapsed().as_secs_f64());
}

/// Drive, measurement and records of a case, as `identify` reads them.
fn write(class: &str, number: &str, folder: &std::path::Path) -> std::io::Result<()> {
    let classes = [Class::Single, Class::Clean, Class::Outside, Class::Confusable, Class::Double];
    let named = |c: &Class| format!("{c:?}").eq_ignore_ascii_case(class);
    let class = classes.into_iter().find(named).ok_or(std::io::ErrorKind::InvalidInput)?;
    let case = blind::case(class, number.parse().map_err(|_| std::io::ErrorKind::InvalidInput)?);
    std::fs::create_dir_all(folder)?;
    std::fs::write(folder.join("drive.toml"), &case.drive_toml)?;
    std::fs::write(folder.join("measurement.toml"), &case.measurement_toml)?;
    for (name, text) in &case.csvs {
        std::fs::write(folder.join(name), text)?;
    }
    println!("{}: {:?}", case.name, case.truth);
    Ok(())
}
