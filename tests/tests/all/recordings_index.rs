//! Every clip in `recordings/` has an origin and a licence in `index.toml`.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

#[test]
fn every_clip_matches_the_index() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../recordings");
    let text = fs::read_to_string(folder.join("index.toml")).unwrap();
    let index: toml::Table = text.parse().unwrap();
    let mut listed = BTreeSet::from(["index.toml".to_owned()]);
    for (name, clip) in &index {
        let field = |key: &str| {
            clip[key]
                .as_str()
                .unwrap_or_else(|| panic!("{name} has no {key}"))
        };
        let bytes = fs::read(folder.join(field("file"))).unwrap();
        assert_eq!(
            blake3::hash(&bytes).to_hex().as_str(),
            field("blake3"),
            "{name}"
        );
        assert!(bytes.len() < 5_000_000, "{name} is too large for a clip");
        assert!(
            !field("origin").is_empty() && !field("licence").is_empty(),
            "{name}"
        );
        listed.insert(field("file").to_owned());
    }
    let names = fs::read_dir(&folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name());
    let found: BTreeSet<_> = names.map(|name| name.into_string().unwrap()).collect();
    assert_eq!(found, listed);
}
