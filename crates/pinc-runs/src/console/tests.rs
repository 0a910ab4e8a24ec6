use super::*;

#[test]
fn texts_from_outside_are_escaped_and_cut() {
    assert_eq!(plain("a\u{1b}[31mb\u{9b}\u{202e}\tc\n"), "a\\u{1b}[31mb\\u{9b}\\u{202e}\tc\n");
    assert!(matches!(plain("a ordinary line, even with é"), Cow::Borrowed(_)));
    let long = format!("begin{}end", "é".repeat(1_000_000));
    let shown = shortened(&long);
    assert!(shown.starts_with("begin") && shown.ends_with("end"));
    assert!(shown.contains("[.. 999208 characters ..]"), "{}", shown.len());
    assert!(shown.chars().count() < LONG);
}
