//! Opening of input files.

use std::fs::File;
use std::io::Result;
use std::path::Path;

/// Opens a file for reading. A pipe without a writer would block the program forever; after five seconds it is an
/// error.
pub fn open(path: &Path) -> Result<File> {
    #[cfg(unix)]
    {
        use rustix::event::{PollFd, PollFlags, Timespec, poll};
        use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
        use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
        const OPEN_TIMEOUT_S: i64 = 5;
        if std::fs::metadata(path)?.file_type().is_fifo() {
            let nonblock = OFlags::NONBLOCK.bits().cast_signed();
            let file = std::fs::OpenOptions::new().read(true).custom_flags(nonblock).open(path)?;
            let wait = |seconds| {
                let timeout = Timespec { tv_sec: seconds, tv_nsec: 0 };
                poll(&mut [PollFd::new(&file, PollFlags::IN)], Some(&timeout))
            };
            if wait(0)? == 0 {
                eprintln!("{} is a pipe without a writer yet; waiting for {OPEN_TIMEOUT_S} s", path.display());
                if wait(OPEN_TIMEOUT_S)? == 0 {
                    return Err(std::io::Error::other("nobody writes into this pipe"));
                }
            }
            fcntl_setfl(&file, fcntl_getfl(&file)? - OFlags::NONBLOCK)?;
            return Ok(file);
        }
    }
    File::open(path)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    /// A pipe is read to its end however late its writer starts; one without a writer is an error.
    #[cfg(unix)]
    #[test]
    fn pipes_are_waited_for_and_not_for_ever() {
        use std::io::{Read, Write};
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
        let late = path.clone();
        let writer = std::thread::spawn(move || {
            std::thread::sleep(std::time::Duration::from_millis(300));
            let mut pipe = std::fs::OpenOptions::new().write(true).open(late).unwrap();
            pipe.write_all(b"first ").unwrap();
            std::thread::sleep(std::time::Duration::from_millis(300));
            pipe.write_all(b"second").unwrap();
        });
        let mut text = String::new();
        super::open(&path).unwrap().read_to_string(&mut text).unwrap();
        writer.join().unwrap();
        assert_eq!(text, "first second");
        let error = super::open(&path).unwrap_err();
        assert!(error.to_string().contains("nobody writes"), "{error}");
    }
}
