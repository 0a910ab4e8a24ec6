//! Tests that every picture must pass.

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
    assert_ticks_differ(svg);
    let words: Vec<Word> = svg.split("<text ").skip(1).map(Word::parse).collect();
    for (i, word) in words.iter().enumerate() {
        let Word { left, right, top, bottom, .. } = word;
        assert!(on_page(*left, *top) && on_page(*right, *bottom), "{word:?} is cut off");
        for other in &words[..i] {
            assert!(!word.covers(other), "{word:?} covers {other:?}");
        }
    }
}

/// No two ticks of a vertical axis have the same label: a panel's labels end at one place, and the
/// turned label of its axis follows on them.
fn assert_ticks_differ(svg: &str) {
    let mut seen = Vec::new();
    for element in svg.lines().filter(|line| line.starts_with("<text")) {
        if element.contains("rotate(") || element.contains("font-weight") {
            seen.clear();
        } else if element.contains("text-anchor=\"end\"") {
            let tick = (attribute(element, "x").to_bits(), word(element));
            assert!(!seen.contains(&tick), "{tick:?} stands twice beside an axis");
            seen.push(tick);
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

/// A panel of a stack read back from its SVG: what is drawn in it, in the units of its axes.
pub(crate) struct Plot {
    /// What stands beside its axis.
    pub(crate) label: String,
    /// What stands below the stack.
    pub(crate) time: String,
    /// The tolerance of values, to which the picture rounds: two tenths of a pixel.
    pub(crate) tolerance: f64,
    elements: Vec<String>,
    x: Scale,
    y: Scale,
}

/// Places on the page and values of an axis: value = first + slope * (place - origin).
struct Scale {
    origin: f64,
    first: f64,
    slope: f64,
}

impl Scale {
    /// The scale of ticks with their places.
    fn of(ticks: &[(f64, f64)]) -> Self {
        let (first, last) = (ticks[0], ticks[ticks.len() - 1]);
        Self { origin: first.0, first: first.1, slope: (last.1 - first.1) / (last.0 - first.0) }
    }

    fn value(&self, place: f64) -> f64 {
        self.first + self.slope * (place - self.origin)
    }
}

impl Plot {
    /// The panel with this title; its axes are linear.
    pub(crate) fn read(svg: &str, title: &str) -> Self {
        let all: Vec<String> = svg.lines().map(str::to_owned).collect();
        let is_title = |line: &String| line.contains("font-weight=\"600\"");
        let named = |line: &String| is_title(line) && line.contains(&format!(">{title}<"));
        let start = all.iter().position(named).unwrap_or_else(|| panic!("no panel {title}"));
        let length = all[start + 1..].iter().position(is_title);
        let elements =
            all[start + 1..length.map_or(all.len(), |length| start + 1 + length)].to_vec();
        let ticks = |lines: &[String], anchor: &str, place: &str, shift: f64| -> Vec<(f64, f64)> {
            let small = |line: &&String| {
                line.contains("font-size=\"12\"")
                    && line.contains(&format!("text-anchor=\"{anchor}\""))
            };
            let tick = |line: &String| {
                (attribute(line, place) - shift, number(&word(line).replace('−', "-")))
            };
            lines.iter().filter(small).map(tick).collect()
        };
        let turned = |line: &&String| line.contains("rotate(");
        // A word's middle is above its baseline by 0.35 of its size.
        let y = Scale::of(&ticks(&elements, "end", "y", 0.35 * 12.0));
        let x = Scale::of(&ticks(&all, "middle", "x", 0.0));
        let below = all.iter().rev().find(|line| line.starts_with("<text")).expect("words");
        Self {
            label: word(elements.iter().find(turned).expect("an axis")),
            time: word(below),
            tolerance: 0.2 * y.slope.abs(),
            elements,
            x,
            y,
        }
    }

    /// The lines that look like the sample of this name in the legend: their points.
    pub(crate) fn lines(&self, name: &str) -> Vec<Vec<(f64, f64)>> {
        let word_of_legend = |line: &String| line.ends_with(&format!(">{name}</text>"));
        let place = self.elements.iter().position(word_of_legend);
        let place = place.unwrap_or_else(|| panic!("no {name} in the legend"));
        let look = |line: &str| line.split_once("fill=\"none\"").map(|(_, look)| look.to_owned());
        let sample = look(&self.elements[place - 1]).expect("a line as a sample");
        let same = |line: &&String| look(line).as_ref() == Some(&sample);
        let points = |line: &String| {
            let points = line.split("points=\"").nth(1).expect("points").split('"').next();
            let point = |point: &str| {
                let (x, y) = point.split_once(',').expect("a point");
                (self.x.value(number(x)), self.y.value(number(y)))
            };
            points.expect("points").split_whitespace().map(point).collect()
        };
        self.elements[place + 1..].iter().filter(same).map(points).collect()
    }

    /// The dots of a panel that has one kind of them and no legend.
    pub(crate) fn dots(&self) -> Vec<(f64, f64)> {
        let dots = self.elements.iter().filter(|line| line.starts_with("<circle"));
        let point = |line: &String| {
            (self.x.value(attribute(line, "cx")), self.y.value(attribute(line, "cy")))
        };
        dots.map(point).collect()
    }

    /// Checks that a line's points are a function of time.
    pub(crate) fn assert_follows(&self, line: &[(f64, f64)], truth: impl Fn(f64) -> f64) {
        assert!(line.len() > 1, "a line of {} points", line.len());
        for (t, value) in line {
            // A tenth of a pixel along the axis of time moves the truth, too.
            let moved = 0.2 * self.x.slope.abs();
            let slack = (truth(t + moved) - truth(t - moved)).abs() + self.tolerance;
            let off = (value - truth(*t)).abs();
            assert!(off <= slack, "{value} instead of {} at {t}, more than {slack} off", truth(*t));
        }
    }
}

fn attribute(element: &str, name: &str) -> f64 {
    let value = element.split(&format!(" {name}=\"")).nth(1).expect("the attribute");
    number(value.split('"').next().expect("its end"))
}

fn word(element: &str) -> String {
    element.split_once('>').expect("an element").1.split('<').next().expect("its end").to_owned()
}
