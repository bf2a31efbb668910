//! Checks that `docs/fits-on.md` agrees with the sizes of this version.
#![allow(clippy::unwrap_used)]

use keygraph_tests::boards::{PROFILES, page};
use keygraph_tests::file;

#[test]
fn the_page_is_current() {
    let path = file("docs/fits-on.md");
    if std::env::var_os("KEYGRAPH_WRITE").is_some() {
        std::fs::write(&path, page()).unwrap();
    }
    let written = std::fs::read_to_string(&path).unwrap_or_default();
    for (n, (is, should)) in written.lines().zip(page().lines()).enumerate() {
        assert_eq!(
            is,
            should,
            "line {} of docs/fits-on.md is out of date; write the page again: KEYGRAPH_WRITE=1 cargo test -p keygraph-tests --test fits_on",
            n + 1
        );
    }
    assert_eq!(written.lines().count(), page().lines().count(), "docs/fits-on.md is cut off or too long");
}

/// Checks that the small profiles fit the boards that they are made for, and that the page says so.
#[test]
fn the_small_profiles_fit_their_boards() {
    assert!(PROFILES[0].ram() <= 192 << 10, "qqvga needs {} bytes: too many for an STM32F405", PROFILES[0].ram());
    assert!(PROFILES[1].ram() <= 512 << 10, "qvga needs {} bytes: too many for an STM32H743", PROFILES[1].ram());
    let page = page();
    let row = |board: &str| page.lines().find(|l| l.starts_with(&format!("| {board}"))).unwrap().to_string();
    assert!(row("STM32F405").contains("| qqvga (computed) | — | compact (computed) |"), "{}", row("STM32F405"));
    let h7 = row("OpenMV Cam H7 (");
    assert!(h7.contains("| qvga (computed) | — | standard (computed) |"), "{h7}");
    for name in ["OPENMV", "NICLA", "PORTENTA", "STM32", "RT1060", "RP2350", "PICO", "RASPBERRY"] {
        assert!(!page.contains(&format!("]({name}")), "a page of {name} has no address");
    }
}
