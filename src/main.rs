fn main() {
    let d = pitchline::drive::BUNDLED[0];
    let over: Vec<String> = std::env::args().skip(1).collect();
    let drive = match pitchline::drive::Drive::parse(d.0, d.1, &over) { Ok(d) => d, Err(e) => { eprintln!("{e}"); std::process::exit(2) } };
    let t = std::time::Instant::now();
    let a = match pitchline::assemble::assemble(&drive) { Ok(a) => a, Err(e) => { eprintln!("{e}"); std::process::exit(1) } };
    println!("{:#?} {:?}", a.report, t.elapsed());
    let (model, mut state) = (a.model, a.state);
    let mut sc = pitchline::integrate::explicit::Scratch::new(&model);
    let t = std::time::Instant::now();
    let n = (0.5 / model.step_s) as u64;
    for _ in 0..n { if let Err(e) = pitchline::integrate::explicit::step(&model, &mut state, &mut sc) { println!("{e}"); break } }
    let el = t.elapsed().as_secs_f64();
    println!("isa {:?} steps {} wall {:.3} s: {:.2} ns/link/step; per sim s {:.3}", sc.isa, n, el, el*1e9/n as f64/90., el/0.5);
    println!("w {:?} work {:?} {:?} hash {:x}", state.rotors.omega, state.rotors.work_in, state.rotors.work_out, state.hash());
}
