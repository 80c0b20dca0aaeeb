//! Damage of the write-ahead log, found before SQLite opens it.
//!
//! SQLite reads the log up to the first frame whose checksum is wrong, and drops the rest without a
//! word: the jobs of those transactions are gone. A process that is killed leaves a log that ends
//! early or with a frame that is not whole, which is no damage; a disk that changes a bit leaves
//! further transactions of the same generation behind the wrong frame. Damage of the last frame of
//! all cannot be told from a frame that was cut off. The format is that of <https://www.sqlite.org/fileformat2.html#walformat>.

use std::fs::{self, File};
use std::io::{self, BufReader, ErrorKind, Read};
use std::path::Path;

const HEADER: usize = 32;
const FRAME_HEADER: usize = 24;
/// The first word of a log, without its last bit, which tells the order of bytes in checksums.
const MAGIC: u32 = 0x377f_0682;
const PAGE_SIZES: std::ops::RangeInclusive<usize> = 512..=65536;

/// What SQLite will drop of a log.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Dropped {
    /// Frames behind the wrong one: pages that were written.
    pub(super) frames: usize,
    /// Those that ended a transaction.
    pub(super) transactions: usize,
}

/// The checksum over words of the log.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Checksum {
    sums: [u32; 2],
    is_big_endian: bool,
}

/// What SQLite will drop of the log at a path; nothing where there is none.
///
/// # Errors
/// When the log cannot be read.
pub(super) fn dropped(path: &Path) -> io::Result<Dropped> {
    let file = match File::open(path) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Dropped::default()),
        file => file?,
    };
    let mut log = BufReader::new(file);
    let Some(header) = read::<HEADER>(&mut log)? else { return Ok(Dropped::default()) };
    // A log that was lengthened and never written.
    if header == [0; HEADER] {
        return Ok(Dropped::default());
    }
    let page_size = word(&header, 8) as usize;
    if !PAGE_SIZES.contains(&page_size) {
        return Ok(without_header(path));
    }
    let mut sum = Checksum { sums: [0; 2], is_big_endian: header[3] & 1 == 1 };
    sum.add(&header[..24]);
    let mut is_whole = word(&header, 0) & !1 == MAGIC && sum.is_at(&header, 24);
    let (mut dropped, mut page) = (Dropped::default(), vec![0; page_size]);
    while let Some(frame) = read::<FRAME_HEADER>(&mut log)? {
        match log.read_exact(&mut page) {
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => break,
            read => read?,
        }
        // Frames of an earlier generation have other salts, and end the log.
        let is_of_this_log = frame[8..16] == header[16..24];
        sum.add(&frame[..8]);
        sum.add(&page);
        if !is_whole && is_of_this_log {
            dropped.frames += 1;
            dropped.transactions += usize::from(word(&frame, 4) > 0);
        }
        is_whole &= is_of_this_log && sum.is_at(&frame, 16);
    }
    // A transaction that was cut off leaves frames of no commit, behind which later ones may end.
    Ok(if dropped.transactions > 0 { dropped } else { Dropped::default() })
}

/// What is dropped of a log whose header does not tell the size of pages.
fn without_header(path: &Path) -> Dropped {
    let length = fs::metadata(path).map_or(0, |meta| meta.len());
    // At least one frame of the largest pages, and who knows how many transactions.
    let frames = (length as usize).saturating_sub(HEADER).div_ceil(*PAGE_SIZES.end());
    Dropped { frames, transactions: frames }
}

/// The next bytes; `None` at the end, also where they are not all there.
fn read<const N: usize>(log: &mut impl Read) -> io::Result<Option<[u8; N]>> {
    let mut bytes = [0; N];
    match log.read_exact(&mut bytes) {
        Ok(()) => Ok(Some(bytes)),
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => Ok(None),
        Err(error) => Err(error),
    }
}

fn word(bytes: &[u8], at: usize) -> u32 {
    bytes[at..at + 4].iter().fold(0, |word, byte| word << 8 | u32::from(*byte))
}

impl Checksum {
    fn add(&mut self, bytes: &[u8]) {
        for pair in bytes.as_chunks::<8>().0 {
            for half in 0..2 {
                let word = word(pair, 4 * half);
                let word = if self.is_big_endian { word } else { word.swap_bytes() };
                let other = self.sums[1 - half];
                self.sums[half] = self.sums[half].wrapping_add(word).wrapping_add(other);
            }
        }
    }

    /// Whether the log has this checksum at a place.
    fn is_at(&self, bytes: &[u8], at: usize) -> bool {
        self.sums == [word(bytes, at), word(bytes, at + 4)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rusqlite::Connection;

    /// A log of several transactions, copied while its database is open.
    fn log() -> (tempfile::TempDir, Vec<u8>, usize) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("database");
        let connection = Connection::open(&path).unwrap();
        connection.pragma_update(None, "journal_mode", "WAL").unwrap();
        connection.execute_batch("CREATE TABLE t (a)").unwrap();
        // A second generation, in front of what is left of the first.
        for _ in 0..2 {
            connection.query_row("PRAGMA wal_checkpoint(RESTART)", [], |_| Ok(())).unwrap();
            for n in 0..10 {
                connection.execute("INSERT INTO t VALUES (zeroblob(?1 * 1000))", [n]).unwrap();
            }
        }
        connection.query_row("PRAGMA wal_checkpoint(RESTART)", [], |_| Ok(())).unwrap();
        for _ in 0..5 {
            connection.execute("INSERT INTO t VALUES (1)", []).unwrap();
        }
        let bytes = fs::read(folder.path().join("database-wal")).unwrap();
        let page = word(&bytes, 8) as usize;
        (folder, bytes, FRAME_HEADER + page)
    }

    fn dropped_of(bytes: &[u8]) -> Dropped {
        let file = tempfile::NamedTempFile::new().unwrap();
        fs::write(file.path(), bytes).unwrap();
        dropped(file.path()).unwrap()
    }

    #[test]
    fn whole_log_and_one_that_ends_early_lose_nothing() {
        let (_folder, bytes, frame) = log();
        assert!(bytes.len() > HEADER + 8 * frame, "frames of both generations");
        for end in [bytes.len(), HEADER + 3 * frame, HEADER + 3 * frame + 100, HEADER, 20, 0] {
            assert_eq!(dropped_of(&bytes[..end]), Dropped::default(), "{end}");
        }
        assert_eq!(dropped(Path::new("/nowhere/at-all")).unwrap(), Dropped::default());
    }

    #[test]
    fn changed_bit_drops_its_frame_and_those_behind() {
        let (_folder, bytes, frame) = log();
        let flipped = |at: usize| {
            let mut bytes = bytes.clone();
            bytes[at] ^= 4;
            dropped_of(&bytes)
        };
        let behind = |frames| Dropped { frames, transactions: frames };
        assert_eq!(flipped(HEADER + FRAME_HEADER + 7), behind(4));
        assert_eq!(flipped(HEADER + 2 * frame + 100), behind(2));
        assert_eq!(flipped(HEADER + 4 * frame + 18), behind(0), "as if the last were cut off");
        assert_eq!(flipped(25), behind(5), "in the checksum of the header");
        assert!(flipped(9).frames > 0, "in the size of the pages");
        // Frames that ended no transaction were never acknowledged.
        let mut bytes = bytes.clone();
        for index in 2..5 {
            bytes[HEADER + index * frame..][4..8].fill(0);
        }
        assert_eq!(dropped_of(&bytes), Dropped::default());
    }
}
