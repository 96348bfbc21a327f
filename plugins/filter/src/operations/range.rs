//! `puncta.filter.range/1`

use puncta_sdk::documents::call::Read;
use puncta_sdk::input::{ColumnRef, Input};
use puncta_sdk::operation::default_plan;
use puncta_sdk::prelude::*;
use puncta_sdk::serde_json::json;

use crate::range::{Limits, Values, check_limits, keep_rows, range_mask};

/// The column that every table has: the number of the row.
const ROW: &str = "row";

/// Keeps the rows whose columns all lie within limits.
#[derive(Params)]
pub struct Range {
    /// Limits of each column, both ends included; a row with NaN in one of them is dropped.
    #[param(default = Ranges::default())]
    pub ranges: Ranges,
}

impl Operation for Range {
    const ID: &'static str = "puncta.filter.range/1";

    fn info() -> Info {
        Info::operation("Filter by ranges")
            .description(
                "Keeps the rows whose named columns all lie within their limits, both ends \
                 included.\nNaN lies within no limits, and an infinite limit is open, so \
                 [-inf, inf] drops NaN only. The column row is the number of the row, from 0.",
            )
            .input(Ports::table("table").description("Any table"))
            .output(Ports::selection("table", "table").description("The rows within the limits"))
            .example(json!({ "ranges": { "error_x": [0, 15], "nPhotons": [50, "inf"] } }))
            .example_input("table", "puncta.synthetic.membrane/1", json!({}))
    }

    fn prepare(&self, request: &Request) -> Result<Plan, Failure> {
        let mut plan = default_plan::<Self>(request);
        let Some(input) = request.inputs.first() else {
            return Ok(plan);
        };
        let mut columns = vec![];
        for (name, [low, high]) in &self.ranges.0 {
            check_limits(name, *low, *high).map_err(|failure| failure.parameter("ranges"))?;
            if is_virtual(&input.header, name) {
                continue;
            }
            check_column(&input.header, name)?;
            columns.push(name.clone());
        }
        plan.read = vec![Read {
            input: 0,
            part: 0,
            columns,
        }];
        plan.memory = super::memory(request);
        Ok(plan)
    }

    fn run(&self, job: &Job) -> Result<(), Failure> {
        let table = job.input("table")?;
        let mut limits = vec![];
        let mut rows = None;
        for (name, [low, high]) in &self.ranges.0 {
            if is_virtual(table.header(), name) {
                rows = Some([*low, *high]);
            } else {
                let values = values(&table, name)?;
                limits.push(Limits {
                    name,
                    values,
                    low: *low,
                    high: *high,
                });
            }
        }
        let mut mask = range_mask(table.rows(), &limits, job)?;
        if let Some([low, high]) = rows {
            keep_rows(&mut mask, low, high);
        }
        super::select(job, &mask)
    }
}

fn is_virtual(header: &Header, name: &str) -> bool {
    name == ROW && header.column(ROW).is_none()
}

fn check_column(header: &Header, name: &str) -> Result<(), Failure> {
    let refuse = |message: String, remedy: String| {
        Err(Failure::bad_parameter("ranges", message).remedy(remedy))
    };
    let Some(column) = header.column(name) else {
        let columns = header.parts.first().map_or(&[][..], |part| &part.columns);
        let names: Vec<&str> = columns.iter().map(|column| column.name.as_str()).collect();
        let message = format!("there is no column {name} in {}", header.name);
        return refuse(message, format!("it has {}", names.join(", ")));
    };
    if column.type_.element.is_text() {
        let message = format!("column {name} of {} holds texts", header.name);
        return refuse(message, "give limits for columns of numbers".into());
    }
    if column.type_.width != 1 {
        let message = format!("column {name} of {} holds lists of numbers", header.name);
        return refuse(message, "give limits for columns of single numbers".into());
    }
    Ok(())
}

fn values<'a>(table: &Input<'a>, name: &str) -> Result<Values<'a>, Failure> {
    Ok(match table.column(0, name)? {
        ColumnRef::U8(values) | ColumnRef::Bool(values) => Values::U8(values),
        ColumnRef::I8(values) => Values::I8(values),
        ColumnRef::U16(values) => Values::U16(values),
        ColumnRef::I16(values) => Values::I16(values),
        ColumnRef::U32(values) => Values::U32(values),
        ColumnRef::I32(values) => Values::I32(values),
        ColumnRef::U64(values) => Values::U64(values),
        ColumnRef::I64(values) => Values::I64(values),
        ColumnRef::F32(values) => Values::F32(values),
        ColumnRef::F64(values) => Values::F64(values),
        ColumnRef::Utf8(_) | ColumnRef::Dictionary(..) => {
            return Err(Failure::bad_input(format!("column {name} holds texts")));
        }
    })
}

puncta_sdk::register!(Range);

#[cfg(test)]
mod tests {
    use super::*;
    use puncta_testkit::{Call, Table};

    fn table() -> Table {
        Table::new("locs")
            .f64("x", "nm", &[0.0, 1.0, 2.0, f64::NAN, 4.0])
            .f32("nPhotons", "photon", &[10.0, 20.0, 30.0, 40.0, 50.0])
            .i32("t", "frame", &[0, 5, 5, 6, 7])
            .texts("name", &["a", "b", "c", "d", "e"])
    }

    fn call(ranges: puncta_sdk::serde_json::Value) -> Call {
        Call::of::<Range>()
            .set("ranges", ranges)
            .input("table", table())
    }

    fn rows(ranges: puncta_sdk::serde_json::Value) -> Vec<u32> {
        let run = |threads| call(ranges.clone()).threads(threads).run().unwrap();
        let one = run(1).output("table").unwrap().u32("row").unwrap();
        assert_eq!(run(2).output("table").unwrap().u32("row").unwrap(), one);
        one
    }

    #[test]
    fn rows_within_all_limits_are_selected() {
        assert_eq!(rows(json!({})), [0, 1, 2, 3, 4]);
        assert_eq!(rows(json!({ "x": ["-inf", "inf"] })), [0, 1, 2, 4]);
        assert_eq!(rows(json!({ "x": [1, 4], "t": [0, 5] })), [1, 2]);
        assert_eq!(
            rows(json!({ "nPhotons": [20, 40], "row": [2, "inf"] })),
            [2, 3]
        );
        assert_eq!(rows(json!({ "row": [0.5, 2.5] })), [1, 2]);
        assert_eq!(rows(json!({ "row": [7, 9] })), [0; 0]);
        assert_eq!(rows(json!({ "t": [8, 9] })), [0; 0]);
    }

    #[test]
    fn only_the_named_columns_are_read() {
        let plan = call(json!({ "t": [0, 5], "row": [0, 1] }))
            .prepare()
            .unwrap();
        assert_eq!(plan.read[0].columns, ["t"]);
        assert_eq!(plan.outputs[0].form, OutputForm::Selection);
    }

    #[test]
    fn bad_ranges_are_refused_before_the_run() {
        let refused = |ranges| call(ranges).prepare().unwrap_err();
        let failure = refused(json!({ "sigma": [0, 1] }));
        assert_eq!(
            failure.to_string(),
            "there is no column sigma in locs; it has x, nPhotons, t, name"
        );
        assert_eq!(failure.parameter.as_deref(), Some("ranges"));
        assert!(refused(json!({ "name": [0, 1] })).message.contains("texts"));
        assert!(refused(json!({ "x": [2, 1] })).message.contains('x'));
        assert!(refused(json!({ "x": ["nan", 1] })).message.contains('x'));
    }

    #[test]
    fn an_empty_table_gives_an_empty_selection_and_cancel_ends_the_call() {
        let empty = Table::new("none").f64("x", "nm", &[]);
        let done = Call::of::<Range>()
            .set("ranges", json!({ "x": [0, 1] }))
            .input("table", empty);
        assert_eq!(
            done.run()
                .unwrap()
                .output("table")
                .unwrap()
                .u32("row")
                .unwrap(),
            [0; 0]
        );
        assert!(
            call(json!({ "x": [0, 1] }))
                .cancel_after(1)
                .run()
                .unwrap_err()
                .is_cancelled()
        );
    }
}
