//! Plots as SVG.

use std::fmt::Write as _;

/// Size of a plot, and of what its axes span.
const WIDTH: f64 = 860.0;
const HEIGHT: f64 = 480.0;
const LEFT: f64 = 60.0;
const RIGHT: f64 = 640.0;
const TOP: f64 = 40.0;
const BOTTOM: f64 = 430.0;

/// Ticks of an axis, about.
const TICKS: f64 = 6.0;

/// Least distance of two labels in the legend.
const LINE: f64 = 17.0;

/// What an axis means.
pub(crate) struct Axis {
    pub(crate) label: &'static str,
    pub(crate) logarithmic: bool,
}

/// A line through points, with a dot at each.
pub(crate) struct Curve {
    pub(crate) label: &'static str,
    pub(crate) color: &'static str,
    pub(crate) points: Vec<(f64, f64)>,
}

/// Curves over two axes.
pub(crate) struct Plot {
    pub(crate) title: String,
    pub(crate) x: Axis,
    pub(crate) y: Axis,
    pub(crate) curves: Vec<Curve>,
}

/// Maps the numbers of an axis to places.
struct Scale {
    logarithmic: bool,
    least: f64,
    most: f64,
    from: f64,
    to: f64,
}

impl Scale {
    fn new(axis: &Axis, values: impl Iterator<Item = f64>, (from, to): (f64, f64)) -> Self {
        let logarithmic = axis.logarithmic;
        let measure = |value: f64| if logarithmic { value.log10() } else { value };
        let finite = values.map(measure).filter(|value| value.is_finite());
        let (least, most) =
            finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, m), v| (l.min(v), m.max(v)));
        let margin = ((most - least) * 0.05).max(1e-3);
        Self { logarithmic, least: least - margin, most: most + margin, from, to }
    }

    fn place(&self, value: f64) -> f64 {
        let value = if self.logarithmic { value.log10() } else { value };
        self.from + (value - self.least) / (self.most - self.least) * (self.to - self.from)
    }

    /// Round numbers within the scale.
    fn ticks(&self) -> Vec<f64> {
        if self.logarithmic {
            let decades = self.least.floor() as i32..=self.most.ceil() as i32;
            let all = decades.flat_map(|d| [1.0, 2.0, 5.0].map(|digit| digit * 10f64.powi(d)));
            return all.filter(|v| (self.least..=self.most).contains(&v.log10())).collect();
        }
        let rough = (self.most - self.least) / TICKS;
        let power = 10f64.powf(rough.log10().floor());
        let digit = [1.0, 2.0, 5.0, 10.0].into_iter().find(|d| d * power >= rough).unwrap_or(10.0);
        let step = digit * power;
        let first = (self.least / step).ceil() as i64;
        (first..).map(|i| i as f64 * step).take_while(|&v| v <= self.most).collect()
    }
}

impl Plot {
    /// The plot as an SVG document.
    pub(crate) fn svg(&self) -> String {
        let all = || self.curves.iter().flat_map(|curve| &curve.points);
        let x = Scale::new(&self.x, all().map(|point| point.0), (LEFT, RIGHT));
        let y = Scale::new(&self.y, all().map(|point| point.1), (BOTTOM, TOP));
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" \
             font-family=\"sans-serif\" font-size=\"12\">\n\
             <rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"white\"/>\n\
             <text x=\"{LEFT}\" y=\"22\" font-size=\"15\">{}</text>\n",
            self.title
        );
        self.axes(&mut svg, &x, &y);
        for curve in &self.curves {
            line(&mut svg, curve, &x, &y);
        }
        self.legend(&mut svg, &x, &y);
        svg.push_str("</svg>\n");
        svg
    }

    fn axes(&self, svg: &mut String, x: &Scale, y: &Scale) {
        for value in x.ticks() {
            let at = x.place(value);
            // Writing to a string does not fail.
            let _ = writeln!(
                svg,
                "<path d=\"M{at:.1} {TOP}V{BOTTOM}\" stroke=\"#e4e4e4\"/><text x=\"{at:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                BOTTOM + 16.0,
                short(value)
            );
        }
        for value in y.ticks() {
            let at = y.place(value);
            let _ = writeln!(
                svg,
                "<path d=\"M{LEFT} {at:.1}H{RIGHT}\" stroke=\"#e4e4e4\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
                LEFT - 6.0,
                at + 4.0,
                short(value)
            );
        }
        let (middle, bottom) = ((LEFT + RIGHT) / 2.0, BOTTOM + 36.0);
        let _ = writeln!(
            svg,
            "<path d=\"M{LEFT} {TOP}V{BOTTOM}H{RIGHT}\" fill=\"none\" stroke=\"black\"/><text x=\"{middle}\" y=\"{bottom}\" text-anchor=\"middle\">{}</text>",
            self.x.label
        );
        let _ = writeln!(
            svg,
            "<text transform=\"translate(16 {:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            (TOP + BOTTOM) / 2.0,
            self.y.label
        );
    }

    /// Names the curves at the right, in the order in which they end, with a thin line to each end.
    fn legend(&self, svg: &mut String, x: &Scale, y: &Scale) {
        let mut ends: Vec<(f64, f64, &Curve)> = self
            .curves
            .iter()
            .filter_map(|curve| curve.points.last().map(|&(a, b)| (y.place(b), x.place(a), curve)))
            .collect();
        ends.sort_by(|a, b| a.0.total_cmp(&b.0));
        let count = ends.len() as f64;
        let mut next = TOP;
        for (i, (end, at, curve)) in ends.into_iter().enumerate() {
            let room = BOTTOM - (count - 1.0 - i as f64) * LINE;
            let place = end.max(next).min(room.max(next));
            next = place + LINE;
            let (from, text) = (RIGHT + 14.0, RIGHT + 30.0);
            let Curve { color, label, .. } = curve;
            let _ = writeln!(
                svg,
                "<path d=\"M{:.1} {end:.1}L{from} {place:.1}H{:.1}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"0.6\"/><text x=\"{text}\" y=\"{:.1}\" fill=\"{color}\">{label}</text>",
                at + 4.0,
                text - 3.0,
                place + 4.0
            );
        }
    }
}

/// A curve with its dots.
fn line(svg: &mut String, curve: &Curve, x: &Scale, y: &Scale) {
    let places: Vec<(f64, f64)> =
        curve.points.iter().map(|&(a, b)| (x.place(a), y.place(b))).collect();
    let path: Vec<String> = places.iter().map(|(a, b)| format!("{a:.1} {b:.1}")).collect();
    let color = curve.color;
    let _ = writeln!(
        svg,
        "<path d=\"M{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.6\"/>",
        path.join("L")
    );
    for (a, b) in places {
        let _ = writeln!(svg, "<circle cx=\"{a:.1}\" cy=\"{b:.1}\" r=\"3\" fill=\"{color}\"/>");
    }
}

/// A number of a tick.
fn short(value: f64) -> String {
    let text = format!("{value:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}
