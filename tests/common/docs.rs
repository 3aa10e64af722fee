//! Commands in README.md and docs/, as the tests read them.

/// Words of a shell's line up to a comment, a pipe or a redirection; quotes keep them together.
pub fn shell_words(line: &str) -> Vec<String> {
    let (mut words, mut quote, mut open) = (vec![String::new()], None, false);
    for c in line.chars() {
        match (quote, c) {
            (None, '\'' | '"') => (quote, open) = (Some(c), true),
            (Some(q), c) if q == c => quote = None,
            (None, '#' | '|' | '>' | '&') if words.last().is_some_and(String::is_empty) && !open => break,
            (None, ' ') => {
                if open || !words.last().is_some_and(String::is_empty) {
                    words.push(String::new());
                }
                open = false;
            }
            _ => words.last_mut().expect("one at least").push(c),
        }
    }
    words.retain(|w| !w.is_empty());
    words
}

/// All pages below a folder, by path.
pub fn pages(folder: &std::path::Path) -> Vec<std::path::PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for path in std::fs::read_dir(folder).expect("a folder").flatten().map(|entry| entry.path()) {
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "md") {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}
