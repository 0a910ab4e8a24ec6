//! Rows of files.

use super::rows;

#[test]
fn rows_know_their_lines_whatever_ends_them() {
    for end in ["\n", "\r\n"] {
        let text = ["t,x", "0,1", "", "1,2", "2,abc", ""].join(end);
        assert_eq!(rows(text.as_bytes()).unwrap_err().0, 5, "{end:?}");
        let lines = rows(text.replace("abc", "3").as_bytes()).unwrap().1;
        assert_eq!(lines.iter().map(|(line, _)| *line).collect::<Vec<_>>(), [2, 4, 5]);
    }
}
