//! The program `thesis_tables` as a reader runs it, on two tiny pictures.

#![allow(clippy::unwrap_used, clippy::panic)] // A failing test may stop anywhere.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const NUMBERS: [&str; 12] = [
    "3.2(b)", "3.3(b)", "3.4(b)", "3.5(b)", "3.6(b)", "3.7(b)", "3.8(b)", "3.9(b)", "4.1", "4.2",
    "4.3", "4.4",
];

/// Meshes that the tables need of a picture: in colour 9 policies one-shot, 9 simplified, 2 of
/// these on the colours, mirroring and classic start-up once more, CGPRFSED, CGPR and MGPR; in gray
/// 3 one-shot, 3 simplified, and GPR.
const COLOUR_CASES: usize = 5 * (9 + 9 + 2 + 2 + 3);
const GRAY_CASES: usize = 5 * (3 + 3 + 1);

/// An empty folder of this test.
fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("thesis_tables").join(name);
    // It is not there the first time.
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    folder
}

/// A folder with `colour.ppm`, 40 by 32, and `gray.pgm`, 36 by 30.
fn pictures(name: &str) -> PathBuf {
    let folder = folder(name);
    let wave = |x: u32, y: u32, k: u32| ((x * x * k + 7 * y * y + x * y * 3) / 16 % 256) as u8;
    let colour = (0..32).flat_map(|y| (0..40).flat_map(move |x| [1, 2, 5].map(|k| wave(x, y, k))));
    let gray = (0..30).flat_map(|y| (0..36).map(move |x| wave(x, y, 3)));
    let colour: Vec<u8> = b"P6 40 32 255\n".iter().copied().chain(colour).collect();
    let gray: Vec<u8> = b"P5 36 30 255\n".iter().copied().chain(gray).collect();
    fs::write(folder.join("colour.ppm"), colour).unwrap();
    fs::write(folder.join("gray.pgm"), gray).unwrap();
    folder
}

/// A file beside a folder of pictures.
fn beside(folder: &Path, extension: &str) -> PathBuf {
    let file = folder.with_extension(extension);
    let _ = fs::remove_file(&file);
    file
}

fn run(folder: &Path, words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_thesis_tables")).arg(folder).args(words).output().unwrap()
}

/// What a run that must succeed wrote.
fn succeed(folder: &Path, words: &[&str]) -> String {
    let output = run(folder, words);
    assert!(output.status.success(), "{words:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// What a run that must fail said.
fn fail(folder: &Path, words: &[&str]) -> String {
    let output = run(folder, words);
    assert!(!output.status.success() && output.stdout.is_empty(), "{words:?} did not fail");
    String::from_utf8(output.stderr).unwrap()
}

/// CSV without the lines of seconds, which differ from run to run.
fn without_seconds(csv: &str) -> String {
    csv.lines().filter(|line| !line.contains(",seconds,")).map(|line| format!("{line}\n")).collect()
}

/// The value in a line of CSV that begins so.
fn value(csv: &str, beginning: &str) -> f64 {
    let line = csv.lines().find(|line| line.starts_with(beginning));
    line.unwrap_or_else(|| panic!("no {beginning}")).split(',').nth(6).unwrap().parse().unwrap()
}

fn line_count(file: &Path) -> usize {
    fs::read_to_string(file).unwrap().lines().count()
}

#[test]
fn every_table_comes_in_every_format() {
    let folder = pictures("formats");
    let journal = beside(&folder, "journal");
    let with = |words: &[&'static str]| {
        let journal = ["--journal", journal.to_str().unwrap()];
        succeed(&folder, &[words, &journal].concat())
    };
    let text = with(&[]);
    let markdown = with(&["--format", "markdown"]);
    let csv = with(&["--format", "csv"]);
    for number in NUMBERS {
        assert!(text.contains(&format!("Table {number}: ")), "{number}");
        assert!(markdown.contains(&format!("## Table {number}: ")), "{number}");
        let id = number.replace(['(', ')'], "");
        assert!(csv.lines().any(|line| line.starts_with(&id)), "{id}");
    }
    for part in ["4.2a,colour,3,CGPR,", "4.2b,gray,1,GPR,", "4.3a,colour,3,MED,", "4.3b,colour,1,"]
    {
        assert!(csv.contains(part), "{part}");
    }
    assert!(!csv.contains("3.2b,gray") && !csv.contains("4.2a,gray"));
    assert!(markdown.contains("GPRFSED-like PSB(D) mirror (on the colours)"));
}

#[test]
fn ranks_differences_and_win_ratios_follow_from_the_psnr_printed() {
    let folder = pictures("figures");
    let csv = succeed(
        &folder,
        &["--format", "csv", "--table", "3.4", "--table", "4.1", "--table", "4.2"],
    );
    let psnr = |image: &str, method: &str, density: &str| {
        value(&csv, &format!("4.2b,{image},1,{method},{density},psnr_db,"))
    };
    let methods = ["ED", "MED", "GPRFSED", "MGPRFS", "GPR"];
    let rank = |image, density| {
        let better = |method| psnr(image, method, density) > psnr(image, "MED", density);
        let equal = |method| psnr(image, method, density) == psnr(image, "MED", density);
        let better = methods.into_iter().filter(|method| better(method)).count() as f64;
        better + (methods.into_iter().filter(|method| equal(method)).count() as f64 + 1.0) / 2.0
    };
    let average = (rank("colour", "4") + rank("gray", "4")) / 2.0;
    assert_eq!(value(&csv, "4.1,all,1,MED,4,average_rank,"), average);

    let name = "ED-like PSA(D) classic less ED-like PSA(L) classic";
    let differences = ["colour", "gray"]
        .map(|image| value(&csv, &format!("3.4b,{image},1,first less second,3,difference_db,")));
    let statistic = |unit: &str| value(&csv, &format!("3.4b,all,1,{name},3,{unit},"));
    assert_eq!(statistic("minimum_difference_db"), differences[0].min(differences[1]));
    assert_eq!(statistic("maximum_difference_db"), differences[0].max(differences[1]));
    let median = (differences[0] + differences[1]) / 2.0;
    assert!((statistic("median_difference_db") - median).abs() < 2e-4);
    let wins = differences.iter().filter(|&&difference| difference > 0.0).count();
    assert_eq!(statistic("win_ratio_percent"), 50.0 * wins as f64);
}

#[test]
fn a_run_that_was_stopped_goes_on_where_it_was() {
    let folder = pictures("resumed");
    let journal = beside(&folder, "journal");
    let words = ["--format", "csv", "--journal", journal.to_str().unwrap()];
    let whole = without_seconds(&succeed(&folder, &words));
    let all = 1 + COLOUR_CASES + 2 * GRAY_CASES;
    assert_eq!(line_count(&journal), all);

    // What a run leaves that is stopped while it writes a line.
    let text = fs::read_to_string(&journal).unwrap();
    let lines: Vec<&str> = text.split_inclusive('\n').collect();
    let (kept, torn) = (lines[..60].concat(), &lines[60][..lines[60].len() - 2]);
    fs::write(&journal, format!("{kept}{torn}")).unwrap();
    assert_eq!(without_seconds(&succeed(&folder, &words)), whole);
    let resumed = fs::read_to_string(&journal).unwrap();
    assert!(resumed.starts_with(&kept) && resumed.ends_with('\n'));
    assert_eq!(line_count(&journal), all);

    // Nothing is left to do.
    assert_eq!(without_seconds(&succeed(&folder, &words)), whole);
    assert_eq!(fs::read_to_string(&journal).unwrap(), resumed);
}

#[test]
fn a_changed_picture_is_not_taken_from_the_journal() {
    let folder = pictures("changed");
    let journal = beside(&folder, "journal");
    let words = ["--format", "csv", "--table", "3.4", "--journal", journal.to_str().unwrap()];
    let before = succeed(&folder, &words);
    let count = line_count(&journal);
    let mut picture = fs::read(folder.join("gray.pgm")).unwrap();
    picture[13..400].fill(90);
    fs::write(folder.join("gray.pgm"), picture).unwrap();
    assert_ne!(succeed(&folder, &words), before);
    assert_eq!(line_count(&journal), count + 10);
}

#[test]
fn a_killed_run_leaves_what_it_finished() {
    let folder = pictures("killed");
    let journal = beside(&folder, "journal");
    let words = ["--format", "csv", "--journal", journal.to_str().unwrap()];
    let mut child = Command::new(env!("CARGO_BIN_EXE_thesis_tables"))
        .arg(&folder)
        .args(words)
        .stdout(std::process::Stdio::null())
        .spawn()
        .unwrap();
    // Lines appear while the run goes on, or it has ended already.
    while child.try_wait().unwrap().is_none() && (!journal.exists() || line_count(&journal) < 20) {
        std::thread::yield_now();
    }
    // It may have ended in the meantime.
    let _ = child.kill();
    child.wait().unwrap();
    assert!(line_count(&journal) >= 20);
    let resumed = without_seconds(&succeed(&folder, &words));
    assert_eq!(resumed, without_seconds(&succeed(&folder, &["--format", "csv"])));
    assert_eq!(line_count(&journal), 1 + COLOUR_CASES + 2 * GRAY_CASES);
}

#[test]
fn a_file_that_is_no_journal_is_left_as_it_is() {
    let folder = pictures("no_journal");
    let file = beside(&folder, "txt");
    fs::write(&file, "a letter").unwrap();
    let message = fail(&folder, &["--journal", file.to_str().unwrap()]);
    assert!(message.contains("no_journal.txt is no journal"), "{message}");
    assert_eq!(fs::read_to_string(file).unwrap(), "a letter");
}

#[test]
fn published_figures_stand_beside() {
    let folder = pictures("published");
    let file = beside(&folder, "csv");
    let lines = "table,image,components,method,density_percent,unit,value\n\
        4.2b,gray,1,ED,0.5,psnr_db,12.34\n\
        4.2b,gray,1,MED,0.5,psnr_db,12.35\n\
        3.2b,colour,3,\"ED-like PSD(Max,D) classic\",2.0,psnr_db,23.45\n\
        3.2b,elsewhere,3,\"ED-like PSD(Max,D) classic\",2.0,psnr_db,1.0\n";
    fs::write(&file, lines).unwrap();
    let with = |words: &[&'static str]| {
        let published = ["--published", file.to_str().unwrap()];
        succeed(&folder, &[words, &published].concat())
    };
    let tables = ["--table", "4.2", "--table", "3.2", "--table", "3.5"];
    let text = with(&tables);
    // By its name in the table, by another name, and where it enters a difference.
    for cell in ["(12.34)", "(23.45)", "(+0.01)"] {
        assert!(text.contains(cell), "{cell}: {text}");
    }
    assert!(
        text.contains("agreement with 3 published figures of PSNR (dB); 1 more are of meshes"),
        "{text}"
    );
    let csv = with(&[&tables[..], &["--format", "csv"]].concat());
    let line = csv.lines().find(|line| line.starts_with("4.2b,gray,1,ED,0.5,psnr_db,")).unwrap();
    let fields: Vec<f64> = line.split(',').skip(6).map(|field| field.parse().unwrap()).collect();
    assert_eq!(fields[1], 12.34);
    assert!((fields[0] - fields[1] - fields[2]).abs() < 1e-9);

    fs::write(&file, format!("{lines}4.2b,gray\n")).unwrap();
    let message = fail(&folder, &["--published", file.to_str().unwrap()]);
    assert!(message.contains("published.csv, line 6: "), "{message}");
}

#[test]
fn a_file_that_is_no_picture_is_skipped_by_name() {
    let folder = pictures("skipped");
    fs::write(folder.join("broken.png"), b"\x89PNG\r\n\x1a\n and no more").unwrap();
    let two =
        pixmesh_meshing::Image::from_bottom_up(2, 2, 8, vec![vec![0, 50, 100, 200]; 2]).unwrap();
    let mut file = fs::File::create(folder.join("two.png")).unwrap();
    pixmesh_codec::write_png(&two, &mut file).unwrap();
    let output = run(&folder, &["--table", "3.4", "--format", "csv"]);
    let messages = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{messages}");
    assert!(messages.contains("broken.png skipped: "), "{messages}");
    assert!(messages.contains("two.png skipped: it has 2 components"), "{messages}");
    assert_eq!(messages.lines().count(), 2, "{messages}");
    assert!(String::from_utf8(output.stdout).unwrap().contains("3.4b,gray,1,"));
}

#[test]
fn a_folder_without_pictures_is_refused_by_name() {
    let empty = folder("empty");
    assert!(fail(&empty, &[]).contains("empty: there is no picture"));
    let missing = fail(&empty.join("missing"), &[]);
    assert!(missing.contains("missing: "), "{missing}");
    let folder = pictures("unwritable");
    let file = folder.join("nowhere").join("tables.md");
    assert!(fail(&folder, &["--output", file.to_str().unwrap()]).contains("nowhere"));
}

#[test]
fn any_number_of_threads_gives_the_same_figures() {
    let folder = pictures("threads");
    let with =
        |threads| without_seconds(&succeed(&folder, &["--format", "csv", "--threads", threads]));
    assert_eq!(with("1"), with("4"));
}

#[test]
fn only_the_tables_asked_for_are_printed_and_only_their_meshes_made() {
    let folder = pictures("some");
    let (journal, output) = (beside(&folder, "journal"), beside(&folder, "md"));
    let files = ["--journal", journal.to_str().unwrap(), "--output", output.to_str().unwrap()];
    let words = ["--table", "3.9", "--format", "markdown", "--summaries"];
    assert_eq!(succeed(&folder, &[&files[..], &words].concat()), "");
    assert_eq!(line_count(&journal), 1 + 2 * 2 * 5);
    let markdown = fs::read_to_string(output).unwrap();
    assert!(markdown.starts_with("## Table 3.9(b): ") && markdown.contains("win ratio (%)"));
    assert_eq!(markdown.matches("## ").count(), 1);
    assert!(!markdown.contains("picture |"), "{markdown}");
}
