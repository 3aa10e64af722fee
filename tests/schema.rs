//! The schema of recordings: `assets/pitchline.desc` is the output of a protobuf compiler for `assets/pitchline.proto`.

#[test]
fn descriptor_is_the_compiled_proto_file() {
    let root = env!("CARGO_MANIFEST_DIR");
    let descriptor = protox::Compiler::new([format!("{root}/assets")])
        .expect("includes")
        .include_source_info(false)
        .open_file("pitchline.proto")
        .expect("the proto file compiles")
        .encode_file_descriptor_set();
    let path = format!("{root}/assets/pitchline.desc");
    if std::env::var_os("PITCHLINE_WRITE_SCHEMA").is_some() {
        std::fs::write(&path, &descriptor).expect("writable");
    }
    let committed = std::fs::read(&path).expect("assets/pitchline.desc");
    assert!(
        committed == descriptor,
        "run PITCHLINE_WRITE_SCHEMA=1 cargo test --release --test schema, and look at the change"
    );
}
