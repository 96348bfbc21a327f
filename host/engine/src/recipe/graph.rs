//! The graph of a recipe, laid out in columns from left to right, as lines of text and as SVG.

use super::{Checked, Source};
use crate::markup::escaped;
use std::collections::BTreeMap;
use std::fmt::Write;

/// What a box of the graph is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeKind {
    /// A file that is read.
    Input,
    /// An operation.
    Step,
    /// A file that is written.
    Output,
}

/// A box of the graph.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// What it is.
    pub kind: NodeKind,
    /// Name of the input or step, or the file.
    pub name: String,
    /// Kind of object, operation or writer.
    pub what: String,
    /// Column from the left.
    pub column: usize,
    /// Place in its column, from the top.
    pub place: usize,
    /// Why it cannot run.
    pub problem: Option<String>,
}

/// An arrow between two boxes, by their places in [`Graph::nodes`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Arrow {
    /// Where the object comes from.
    pub from: usize,
    /// Which output; empty where there is one.
    pub output: String,
    /// Where it goes.
    pub to: usize,
    /// Which port; empty where there is one.
    pub port: String,
}

/// A recipe as boxes and arrows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Graph {
    /// Inputs, steps, outputs: each after those that it needs.
    pub nodes: Vec<Node>,
    /// Arrows.
    pub arrows: Vec<Arrow>,
}

impl Graph {
    /// The graph of a recipe.
    #[must_use]
    pub fn of(plan: &Checked) -> Graph {
        let mut graph = Graph::default();
        for input in &plan.inputs {
            let what = match input.many {
                true => format!("{}s", input.kind),
                false => input.kind.to_string(),
            };
            graph.add(NodeKind::Input, &input.name, what, input.failure.as_ref());
        }
        for step in &plan.steps {
            graph.add(
                NodeKind::Step,
                &step.name,
                step.op.to_string(),
                step.failure.as_ref(),
            );
        }
        for output in &plan.outputs {
            let writer = output.writer.as_ref().map(|writer| writer.id.clone());
            let what = writer.unwrap_or_default();
            graph.add(
                NodeKind::Output,
                &output.file,
                what,
                output.failure.as_ref(),
            );
        }
        for (at, step) in plan.steps.iter().enumerate() {
            let inputs = step.operation.as_ref().map_or(&[][..], |one| &one.inputs);
            for bound in &step.ports {
                let port = inputs.get(bound.port).filter(|_| inputs.len() > 1);
                let port = port.map(|port| port.name.clone()).unwrap_or_default();
                for source in &bound.sources {
                    graph.connect(plan, *source, plan.inputs.len() + at, port.clone());
                }
            }
        }
        for (at, output) in plan.outputs.iter().enumerate() {
            let to = plan.inputs.len() + plan.steps.len() + at;
            if let Some(source) = output.source {
                graph.connect(plan, source, to, String::new());
            }
        }
        graph.lay_out();
        graph
    }

    fn add(
        &mut self,
        kind: NodeKind,
        name: &str,
        what: String,
        failure: Option<&puncta_documents::Failure>,
    ) {
        self.nodes.push(Node {
            kind,
            name: name.to_owned(),
            what,
            column: 0,
            place: 0,
            problem: failure.map(ToString::to_string),
        });
    }

    fn connect(&mut self, plan: &Checked, source: Source, to: usize, port: String) {
        let (from, output) = match source {
            Source::Input(at) => (at, String::new()),
            Source::Step { step, output } => {
                let operation = plan
                    .steps
                    .get(step)
                    .and_then(|step| step.operation.as_ref());
                let outputs = operation.map_or(&[][..], |one| &one.outputs);
                let named = outputs.get(output).filter(|_| outputs.len() > 1);
                let named = named.map(|port| port.name.clone()).unwrap_or_default();
                (plan.inputs.len() + step, named)
            }
        };
        self.arrows.push(Arrow {
            from,
            output,
            to,
            port,
        });
    }

    /// Each box a column right of the last that it needs; within a column in the order of the
    /// middles of what they come from, so that few arrows cross.
    fn lay_out(&mut self) {
        // Arrows lead to later nodes only, in the order of their targets.
        for at in 0..self.nodes.len() {
            let before = self.arrows.iter().filter(|arrow| arrow.to == at);
            let columns = before.filter_map(|arrow| self.nodes.get(arrow.from));
            let column = columns.map(|node| node.column + 1).max().unwrap_or(0);
            if let Some(node) = self.nodes.get_mut(at) {
                node.column = column;
            }
        }
        let mut columns: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (at, node) in self.nodes.iter().enumerate() {
            columns.entry(node.column).or_default().push(at);
        }
        for mut column in columns.into_values() {
            column.sort_by(|a, b| self.middle(*a).total_cmp(&self.middle(*b)));
            for (place, at) in column.into_iter().enumerate() {
                if let Some(node) = self.nodes.get_mut(at) {
                    node.place = place;
                }
            }
        }
    }

    fn middle(&self, of: usize) -> f64 {
        let before = self.arrows.iter().filter(|arrow| arrow.to == of);
        let places: Vec<f64> = before
            .filter_map(|arrow| self.nodes.get(arrow.from))
            .map(|node| node.place as f64)
            .collect();
        match places.len() {
            0 => of as f64,
            count => places.iter().sum::<f64>() / count as f64,
        }
    }

    /// A line for each arrow, in the order of the work.
    #[must_use]
    pub fn text(&self) -> String {
        let mut out = String::new();
        let end = |at: usize, port: &str| {
            let name = self.nodes.get(at).map_or("", |node| &node.name);
            match port {
                "" => name.to_owned(),
                port => format!("{name}.{port}"),
            }
        };
        for arrow in &self.arrows {
            let (from, to) = (end(arrow.from, &arrow.output), end(arrow.to, &arrow.port));
            let _ = writeln!(out, "{from} -> {to}");
        }
        out
    }

    /// A picture.
    #[must_use]
    pub fn svg(&self) -> String {
        let widths = self.widths();
        let columns = self
            .nodes
            .iter()
            .map(|node| node.column + 1)
            .max()
            .unwrap_or(0);
        let rows = self
            .nodes
            .iter()
            .map(|node| node.place + 1)
            .max()
            .unwrap_or(0);
        let left = |column: usize| {
            let before = widths.iter().take(column);
            MARGIN + before.map(|width| width + GAP).sum::<f64>()
        };
        let top = |place: usize| MARGIN + place as f64 * (HEIGHT + SPACE);
        let (width, height) = (left(columns) - GAP + MARGIN, top(rows) - SPACE + MARGIN);
        let mut out = String::new();
        let _ = writeln!(
            out,
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width:.0}\" height=\"{height:.0}\" \
             viewBox=\"0 0 {width:.0} {height:.0}\" font-family=\"sans-serif\">\n\
             <rect width=\"100%\" height=\"100%\" fill=\"white\"/>"
        );
        for arrow in &self.arrows {
            let (Some(from), Some(to)) = (self.nodes.get(arrow.from), self.nodes.get(arrow.to))
            else {
                continue;
            };
            let x = left(from.column) + widths.get(from.column).copied().unwrap_or(0.0);
            let (y, end) = (top(from.place) + HEIGHT / 2.0, top(to.place) + HEIGHT / 2.0);
            let to = left(to.column);
            let bend = GAP / 2.0;
            let _ = writeln!(
                out,
                "<path d=\"M{x:.1} {y:.1} C{:.1} {y:.1} {:.1} {end:.1} {to:.1} {end:.1}\" \
                 fill=\"none\" stroke=\"#666\" stroke-width=\"1.5\"/>",
                x + bend,
                to - bend
            );
            label(&mut out, x + 5.0, y - 4.0, "start", &arrow.output);
            label(&mut out, to - 5.0, end - 4.0, "end", &arrow.port);
        }
        for node in &self.nodes {
            let width = widths.get(node.column).copied().unwrap_or(0.0);
            draw(&mut out, node, left(node.column), top(node.place), width);
        }
        out.push_str("</svg>\n");
        out
    }

    /// How wide the boxes of each column are.
    fn widths(&self) -> Vec<f64> {
        let mut widths = Vec::new();
        for node in &self.nodes {
            if widths.len() <= node.column {
                widths.resize(node.column + 1, 0.0_f64);
            }
            let letters = node
                .name
                .chars()
                .count()
                .max(node.what.chars().count() * 6 / 7);
            if let Some(width) = widths.get_mut(node.column) {
                *width = width.max(letters as f64 * LETTER + 2.0 * MARGIN);
            }
        }
        widths
    }
}

/// Around the picture, and within boxes, pixels.
const MARGIN: f64 = 12.0;
/// Between columns.
const GAP: f64 = 90.0;
/// Of a box.
const HEIGHT: f64 = 46.0;
/// Between boxes.
const SPACE: f64 = 18.0;
/// Of a letter, at most.
const LETTER: f64 = 8.2;

fn label(out: &mut String, x: f64, y: f64, anchor: &str, text: &str) {
    if !text.is_empty() {
        let _ = writeln!(
            out,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"11\" fill=\"#666\" \
             text-anchor=\"{anchor}\">{}</text>",
            escaped(text)
        );
    }
}

fn draw(out: &mut String, node: &Node, x: f64, y: f64, width: f64) {
    let (fill, stroke) = match (&node.problem, node.kind) {
        (Some(_), _) => ("#fdecea", "#a8201a"),
        (None, NodeKind::Input) => ("#eaf2fb", "#2b6cb0"),
        (None, NodeKind::Step) => ("#f5f5f5", "#444"),
        (None, NodeKind::Output) => ("#eaf7ee", "#1a6b2b"),
    };
    let round = if node.kind == NodeKind::Step { 5 } else { 22 };
    let _ = write!(
        out,
        "<g><rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{HEIGHT}\" \
         rx=\"{round}\" fill=\"{fill}\" stroke=\"{stroke}\"/>"
    );
    if let Some(problem) = &node.problem {
        let _ = write!(out, "<title>{}</title>", escaped(problem));
    }
    let middle = x + width / 2.0;
    let (name, what) = (escaped(&node.name), escaped(&node.what));
    let _ = writeln!(
        out,
        "<text x=\"{middle:.1}\" y=\"{:.1}\" font-size=\"14\" text-anchor=\"middle\">{name}</text>\
         <text x=\"{middle:.1}\" y=\"{:.1}\" font-size=\"12\" fill=\"#555\" \
         text-anchor=\"middle\">{what}</text></g>",
        y + 20.0,
        y + 37.0
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recipe::mock::Mock;
    use crate::recipe::{check, parse};

    fn graph(steps: &str) -> Graph {
        let text =
            format!("format = \"puncta.recipe/1\"\n[inputs.locs]\nkind = \"table\"\n{steps}");
        Graph::of(&check(&parse(&text).unwrap(), &Mock::new()))
    }

    #[test]
    fn every_box_lies_right_of_what_it_needs() {
        let graph = graph(
            "[steps.b]\nop = \"a.nothing/9\"\nin.table = \"locs\"\n[outputs]\n\"a&b.csv\" = \"locs\"\n",
        );
        for arrow in &graph.arrows {
            assert!(graph.nodes[arrow.from].column < graph.nodes[arrow.to].column);
        }
        assert!(graph.text().contains("locs -> a&b.csv"), "{}", graph.text());
        let mut places: Vec<_> = graph.nodes.iter().map(|n| (n.column, n.place)).collect();
        places.sort_unstable();
        places.dedup();
        assert_eq!(places.len(), graph.nodes.len());
        let svg = graph.svg();
        assert!(svg.contains("a&amp;b.csv") && !svg.contains("a&b"), "{svg}");
        assert!(svg.contains("a.nothing/9") && svg.contains("<title>"));
    }

    #[test]
    fn an_empty_recipe_is_an_empty_picture() {
        let graph = Graph::of(&Checked::default());
        assert_eq!(graph.text(), "");
        assert!(graph.svg().ends_with("</svg>\n"));
    }
}
