//! Writing of output files. No output is ever one of the inputs, and an existing file remains until its replacement is
//! complete.
//!
//! * A file is written under a hidden name next to its own, `.NAME.*.part`, and renamed when it is complete. If it is
//!   abandoned, it is removed; a program that is killed leaves the hidden file.
//! * A recording can be read while it grows. It is hidden only until its beginning is written ([`OutputFile::show`]),
//!   so that no run leaves a recording that does not open. If its name is free, it then has that name. If a file with
//!   that name exists, the recording grows next to it as `NAME.unfinished.mcap`, and replaces it when the run has ended
//!   well. A run that is killed leaves both.
//! * A pipe or a device is written directly.

use anyhow::{Context, Result, bail};
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

/// Maximum number of names tried for a file next to another one.
const MAX_NAMES: usize = 1000;
/// Maximum number of consecutive symbolic links.
const MAX_LINKS: usize = 40;

/// Where an unfinished file is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PublishMode {
    /// Under another name, renamed by [`OutputFile::publish`], otherwise removed.
    Hidden,
    /// Under another name, renamed by [`OutputFile::publish`], otherwise kept.
    Unfinished,
    /// Under its own name, which was free.
    Own,
    /// A pipe or a device.
    Stream,
}

/// A file that is being written.
#[derive(Debug)]
pub struct OutputFile {
    /// As given by the user.
    path: PathBuf,
    /// The file after following symbolic links.
    target: PathBuf,
    written_as: PathBuf,
    way: PublishMode,
    published: bool,
}

impl OutputFile {
    /// Opens a new hidden file next to `path`; a pipe or a device is opened directly.
    pub fn create(path: &Path) -> Result<(OutputFile, File)> {
        OutputFile::open(path).with_context(|| format!("cannot write {}", path.display()))
    }

    fn open(path: &Path) -> Result<(OutputFile, File)> {
        // Special files are opened by the given name, because resolving links to pipes fails.
        if let Ok(there) = std::fs::metadata(path)
            && !there.is_file()
            && !there.is_dir()
        {
            let (path, way) = (path.to_path_buf(), PublishMode::Stream);
            let file = stream(&path)?;
            let (target, written_as) = (path.clone(), path.clone());
            return Ok((OutputFile { path, target, written_as, way, published: false }, file));
        }
        let target = followed(path)?;
        let replaced = match std::fs::metadata(&target) {
            Ok(there) if there.is_dir() => bail!("it is a directory"),
            Ok(there) if there.permissions().readonly() => bail!("it is write-protected"),
            Ok(there) => Some(there.permissions()),
            Err(e) if e.kind() != ErrorKind::NotFound => return Err(e.into()),
            Err(_) => None,
        };
        let (written_as, file) = hidden(&target)?;
        let output =
            OutputFile { path: path.to_path_buf(), target, written_as, way: PublishMode::Hidden, published: false };
        if let Some(permissions) = replaced {
            // With the permissions of the file that it replaces.
            file.set_permissions(permissions)?;
        }
        Ok((output, file))
    }

    /// Makes a recording visible whose beginning is written: under its own name if that is free, otherwise as
    /// unfinished.
    pub fn show(&mut self) -> Result<()> {
        if self.way != PublishMode::Hidden || self.published {
            return Ok(());
        }
        let shown = match renamed_to_free(&self.written_as, &self.target) {
            Ok(true) => Ok((self.target.clone(), PublishMode::Own)),
            Ok(false) => unfinished(&self.target, &self.written_as).map(|path| (path, PublishMode::Unfinished)),
            Err(e) => Err(e.into()),
        };
        (self.written_as, self.way) = shown.with_context(|| format!("cannot write {}", self.path.display()))?;
        Ok(())
    }

    /// The name given by the user.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Current path of the data.
    pub fn current_path(&self) -> &Path {
        if self.published || self.way == PublishMode::Own { &self.path } else { &self.written_as }
    }

    /// Waits until the data are on the disk; does nothing for a pipe or a device.
    pub fn sync(&self, file: &File) -> std::io::Result<()> {
        if self.way == PublishMode::Stream { Ok(()) } else { file.sync_all() }
    }

    /// Renames the complete file to its final name, replacing an existing file. A second call does nothing.
    pub fn publish(&mut self) -> Result<()> {
        if !self.published && matches!(self.way, PublishMode::Hidden | PublishMode::Unfinished) {
            std::fs::rename(&self.written_as, &self.target).with_context(|| {
                format!("cannot write {}; it is complete in {}", self.path.display(), self.written_as.display())
            })?;
        }
        self.published = true;
        Ok(())
    }
}

impl Drop for OutputFile {
    fn drop(&mut self) {
        if !self.published && self.way == PublishMode::Hidden {
            // A file that cannot be removed is hidden, and is nobody's input.
            let _removed = std::fs::remove_file(&self.written_as);
        }
    }
}

/// Writes a file atomically: it has all its bytes, or remains as it was.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    let (mut output, mut file) = OutputFile::create(path)?;
    let written = file.write_all(bytes).and_then(|()| output.sync(&file));
    written.with_context(|| format!("cannot write {}", path.display()))?;
    output.publish()
}

/// The file that a path refers to, also if its last link leads to a file that does not exist yet.
fn followed(path: &Path) -> std::io::Result<PathBuf> {
    let mut path = path.to_path_buf();
    for _ in 0..MAX_LINKS {
        match std::fs::read_link(&path) {
            Ok(to) => path = path.parent().map_or(to.clone(), |folder| folder.join(to)),
            // Not a link, or missing.
            Err(_) => return Ok(path),
        }
    }
    Err(std::io::Error::other("too many symbolic links"))
}

/// A new file `.NAME.PROCESS-NUMBER.part` next to `target`.
fn hidden(target: &Path) -> Result<(PathBuf, File)> {
    /// File systems allow names of 255 bytes; a letter has up to four.
    const LETTERS: usize = 50;
    let name: String = target.file_name().unwrap_or_default().to_string_lossy().chars().take(LETTERS).collect();
    let process = std::process::id();
    for number in 0..MAX_NAMES {
        let path = target.with_file_name(format!(".{name}.{process}-{number}.part"));
        match OpenOptions::new().read(true).write(true).create_new(true).open(&path) {
            Ok(file) => return Ok((path, file)),
            Err(e) if e.kind() == ErrorKind::AlreadyExists => {}
            Err(e) => return Err(e.into()),
        }
    }
    bail!("all hidden names beside {} are taken", target.display())
}

/// Renames `written_as` to the first free one of `STEM.unfinished.EXTENSION`, `STEM.unfinished-2.EXTENSION`, ... next
/// to `target`.
fn unfinished(target: &Path, written_as: &Path) -> Result<PathBuf> {
    let stem = target.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let extension = target.extension().map_or(String::new(), |e| format!(".{}", e.to_string_lossy()));
    for number in 1..=MAX_NAMES {
        let which = if number == 1 { String::new() } else { format!("-{number}") };
        let path = target.with_file_name(format!("{stem}.unfinished{which}{extension}"));
        if renamed_to_free(written_as, &path)? {
            return Ok(path);
        }
    }
    bail!("{stem}.unfinished{extension} and all names like it are taken")
}

/// Renames a file if the new name is free, and returns whether it was. Existing files are never replaced.
fn renamed_to_free(from: &Path, to: &Path) -> std::io::Result<bool> {
    match std::fs::hard_link(from, to) {
        // If removing fails, the remaining second name is hidden.
        Ok(()) => std::fs::remove_file(from).map(|()| true),
        Err(e) if e.kind() == ErrorKind::AlreadyExists => Ok(false),
        // File systems without hard links: the name is first reserved by an empty file.
        Err(_) => match OpenOptions::new().write(true).create_new(true).open(to) {
            Ok(_taken) => std::fs::rename(from, to).map(|()| true),
            Err(e) if e.kind() == ErrorKind::AlreadyExists => Ok(false),
            Err(e) => Err(e),
        },
    }
}

/// Opens a pipe or a device. A pipe without a reader would block the program forever.
fn stream(path: &Path) -> Result<File> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
        use std::time::{Duration, Instant};
        /// How long a pipe may be without a reader.
        const OPEN_TIMEOUT: Duration = Duration::from_secs(5);
        if std::fs::metadata(path)?.file_type().is_fifo() {
            let asked = Instant::now();
            let mut said = false;
            loop {
                let mut options = OpenOptions::new();
                options.write(true).custom_flags(rustix::fs::OFlags::NONBLOCK.bits().cast_signed());
                match options.open(path) {
                    // There is a reader: opened again, so that writes wait for it.
                    Ok(_first) => return Ok(OpenOptions::new().write(true).open(path)?),
                    Err(e) if e.raw_os_error() != Some(rustix::io::Errno::NXIO.raw_os_error()) => return Err(e.into()),
                    Err(_) if asked.elapsed() > OPEN_TIMEOUT => bail!("nobody reads this pipe"),
                    Err(_) => {}
                }
                if !std::mem::replace(&mut said, true) {
                    eprintln!("{} is a pipe without a reader; waiting for {OPEN_TIMEOUT:?}", path.display());
                }
                std::thread::sleep(Duration::from_millis(50));
            }
        }
    }
    Ok(OpenOptions::new().write(true).open(path)?)
}

/// Whether two paths refer to the same file under any name; for a missing file, to the same location.
pub fn same_file(a: &Path, b: &Path) -> bool {
    if let (Ok(a), Ok(b)) = (identity(a), identity(b)) {
        return a == b;
    }
    let place = |path: &Path| {
        let path = followed(path).ok()?;
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder.to_path_buf(),
            _ => PathBuf::from("."),
        };
        Some((folder.canonicalize().ok()?, path.file_name()?.to_os_string()))
    };
    place(a).is_some_and(|a| place(b) == Some(a))
}

/// Device and inode. Never opens the file, because a pipe would wait for its other end.
#[cfg(unix)]
fn identity(path: &Path) -> std::io::Result<(u64, u64)> {
    use std::os::unix::fs::MetadataExt;
    let there = std::fs::metadata(path)?;
    Ok((there.dev(), there.ino()))
}

#[cfg(not(unix))]
fn identity(path: &Path) -> std::io::Result<PathBuf> {
    path.canonicalize()
}

/// Why a file cannot be an output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum UnfitOutput {
    Directory(PathBuf),
    /// e.g. `..`, which ends in no name.
    Nameless(PathBuf),
    GivenTwice(PathBuf),
    /// Two names of one file.
    SameFile(PathBuf, PathBuf),
    /// The file is one of the inputs, perhaps by another name.
    IsInput {
        output: PathBuf,
        input: PathBuf,
    },
}

impl std::fmt::Display for UnfitOutput {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            UnfitOutput::Directory(path) => write!(f, "{} is a directory, not a file to write", path.display()),
            UnfitOutput::Nameless(path) => write!(f, "{} is no name of a file to write", path.display()),
            UnfitOutput::GivenTwice(path) => write!(f, "{} is given twice", path.display()),
            UnfitOutput::SameFile(a, b) => write!(f, "{} and {} are one file", a.display(), b.display()),
            UnfitOutput::IsInput { output, input } => {
                let what = if input.extension().is_some_and(|e| e == "toml") { "the drive" } else { "the input" };
                write!(f, "{} is {what} ", output.display())?;
                if output == input {
                    f.write_str("itself")?
                } else {
                    write!(f, "{}", input.display())?
                }
                f.write_str("; it is not overwritten")
            }
        }
    }
}

impl std::error::Error for UnfitOutput {}

/// Checks outputs before anything is computed: no directory, no input, no file twice. The error is one sentence.
pub fn check<'a>(
    outputs: impl IntoIterator<Item = &'a Path>,
    inputs: impl IntoIterator<Item = &'a Path> + Clone,
) -> Result<(), UnfitOutput> {
    let mut seen: Vec<&Path> = Vec::new();
    for path in outputs {
        let output = path.to_path_buf();
        if path.is_dir() {
            return Err(UnfitOutput::Directory(output));
        }
        if path.file_name().is_none() {
            return Err(UnfitOutput::Nameless(output));
        }
        // A device may be given twice.
        let is_device = std::fs::metadata(path).is_ok_and(|there| !there.is_file());
        if let Some(other) = seen.iter().find(|other| !is_device && same_file(path, other)) {
            return Err(if path == *other {
                UnfitOutput::GivenTwice(output)
            } else {
                UnfitOutput::SameFile(output, other.to_path_buf())
            });
        }
        for input in inputs.clone() {
            if same_file(path, input) {
                return Err(UnfitOutput::IsInput { output, input: input.to_path_buf() });
            }
        }
        seen.push(path);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_whole_or_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.svg");
        write(&path, b"one").unwrap();
        let (output, mut file) = OutputFile::create(&path).unwrap();
        file.write_all(b"tw").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"one");
        drop((output, file));
        assert_eq!(std::fs::read(&path).unwrap(), b"one");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        write(&path, b"two").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"two");
    }

    #[test]
    fn a_recording_grows_beside_the_one_that_it_replaces() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let (mut first, mut file) = OutputFile::create(&path).unwrap();
        file.write_all(b"first").unwrap();
        assert!(!path.exists());
        first.show().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
        assert_eq!(first.current_path(), path);
        first.publish().unwrap();
        let (mut second, mut file) = OutputFile::create(&path).unwrap();
        file.write_all(b"second").unwrap();
        second.show().unwrap();
        let kept = second.current_path().to_path_buf();
        assert_eq!(kept, folder.path().join("a.unfinished.mcap"));
        // Abandoned: both files exist.
        drop(second);
        assert_eq!(std::fs::read(&kept).unwrap(), b"second");
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
        let (mut third, mut file) = OutputFile::create(&path).unwrap();
        third.show().unwrap();
        assert_eq!(third.current_path(), folder.path().join("a.unfinished-2.mcap"));
        file.write_all(b"third").unwrap();
        third.publish().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"third");
        // No hidden file is left.
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[cfg(unix)]
    #[test]
    fn one_file_is_known_by_all_its_names() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("a.mcap"), b"a").unwrap();
        std::fs::hard_link(at("a.mcap"), at("hard.mcap")).unwrap();
        std::os::unix::fs::symlink(at("a.mcap"), at("soft.mcap")).unwrap();
        std::os::unix::fs::symlink("new.mcap", at("dangling.mcap")).unwrap();
        std::os::unix::fs::symlink(folder.path(), at("folder")).unwrap();
        let (a, new) = (at("a.mcap"), at("new.mcap"));
        for name in ["a.mcap", "./a.mcap", "hard.mcap", "soft.mcap", "folder/a.mcap"] {
            let said = check([at(name).as_path()], [a.as_path()]).unwrap_err().to_string();
            assert!(said.contains("is the input") && said.ends_with("it is not overwritten"), "{name}: {said}");
        }
        for name in ["dangling.mcap", "folder/new.mcap", "./new.mcap"] {
            let said = check([at(name).as_path(), new.as_path()], []).unwrap_err().to_string();
            assert!(said.ends_with("are one file") || said.ends_with("given twice"), "{name}: {said}");
        }
        check([new.as_path()], [a.as_path()]).unwrap();
        // Links are followed: their targets are replaced, and the links remain.
        write(&at("soft.mcap"), b"b").unwrap();
        write(&at("dangling.mcap"), b"c").unwrap();
        assert!(at("soft.mcap").is_symlink() && at("dangling.mcap").is_symlink());
        assert_eq!((std::fs::read(a).unwrap(), std::fs::read(new).unwrap()), (b"b".to_vec(), b"c".to_vec()));
        // The other name of a hard-linked file keeps its content.
        assert_eq!(std::fs::read(at("hard.mcap")).unwrap(), b"a");
    }
}
