//! What every picture has to be like.

use pinc_chart::width_of;

/// No picture has a number that is none, all that is drawn lies on the page, and no word covers
/// another one.
pub(crate) fn assert_sound(svg: &str) {
    assert!(!svg.contains("NaN") && !svg.contains("inf"), "a number that is none");
    let size = svg.split("viewBox=\"0 0 ").nth(1).unwrap();
    let size: Vec<f64> = size.split('"').next().unwrap().split(' ').map(number).collect();
    let on_page = |x: f64, y: f64| (0.0..=size[0]).contains(&x) && (0.0..=size[1]).contains(&y);
    for points in svg.split("points=\"").skip(1) {
        for point in points.split('"').next().unwrap().split_whitespace() {
            let (x, y) = point.split_once(',').unwrap();
            assert!(on_page(number(x), number(y)), "{point} is outside of {size:?}");
        }
    }
    let words: Vec<Word> = svg.split("<text ").skip(1).map(Word::parse).collect();
    for (i, word) in words.iter().enumerate() {
        let Word { left, right, top, bottom, .. } = word;
        assert!(on_page(*left, *top) && on_page(*right, *bottom), "{word:?} is cut off");
        for other in &words[..i] {
            assert!(!word.covers(other), "{word:?} covers {other:?}");
        }
    }
}

/// A word's place on the page.
#[derive(Debug)]
struct Word {
    text: String,
    left: f64,
    right: f64,
    top: f64,
    bottom: f64,
}

impl Word {
    /// Reads what follows on `<text `.
    fn parse(element: &str) -> Self {
        let attribute = |name: &str| {
            let value = element.split(&format!("{name}=\"")).nth(1)?;
            value.split('"').next()
        };
        let [x, y, size] = ["x", "y", "font-size"].map(|name| number(attribute(name).unwrap()));
        let text = element.split_once('>').unwrap().1.split('<').next().unwrap();
        let text = text.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
        // The estimate is generous, for layout; letters without the parts below the line.
        let (width, height) = (0.85 * width_of(&text, size), 0.72 * size);
        let start = match attribute("text-anchor").unwrap() {
            "start" => 0.0,
            "middle" => 0.5,
            _ => 1.0,
        };
        let (along, across) = ((-start * width, (1.0 - start) * width), (-height, 0.0));
        let (horizontal, vertical) = match attribute("transform") {
            // Turned by a right angle to be read from the right.
            Some(_) => (across, (-along.1, -along.0)),
            None => (along, across),
        };
        Self {
            text,
            left: x + horizontal.0,
            right: x + horizontal.1,
            top: y + vertical.0,
            bottom: y + vertical.1,
        }
    }

    fn covers(&self, other: &Self) -> bool {
        let empty = self.text.is_empty() || other.text.is_empty();
        let beside = self.right <= other.left || other.right <= self.left;
        let above = self.bottom <= other.top || other.bottom <= self.top;
        !empty && !beside && !above
    }
}

fn number(text: &str) -> f64 {
    text.parse().unwrap()
}
