//! Columns of one entity, collected over a block of rows and sent together. Rows are ragged: a row of `contacts` has as
//! many values as there are contacts. The arrays are built here, because the crate's archetype builders copy value by
//! value.

use crate::recording::columns;
use anyhow::Result;
use rerun::external::arrow::array::{
    ArrayRef, BooleanArray, FixedSizeListArray, Float32Array, Float64Array, StringArray, UInt16Array, UInt64Array,
};
use rerun::external::arrow::datatypes::{DataType, Field};
use rerun::{
    ComponentDescriptor, ComponentIdentifier, EntityPath, RecordingStream, SerializedComponentBatch, TimeColumn,
};
use std::sync::Arc;

/// Values of a column, all rows one after the other.
pub enum ComponentValues {
    F64(Vec<f64>),
    F32(Vec<f32>),
    /// Points and vectors, three numbers each.
    Vec3(Vec<f32>),
    /// Quaternions x, y, z, w.
    Quaternion(Vec<f32>),
    U16(Vec<u16>),
    U64(Vec<u64>),
    Bool(Vec<bool>),
    Text(Vec<String>),
}

/// Name and values of one component.
pub struct ComponentColumn {
    descriptor: ComponentDescriptor,
    values: ComponentValues,
}

/// All components of one entity.
pub struct EntityTable {
    entity: EntityPath,
    /// Values per row.
    lengths: Vec<usize>,
    columns: Vec<ComponentColumn>,
}

/// Row times of a block.
#[derive(Default)]
pub struct Times {
    sim_time_ns: Vec<i64>,
    step: Vec<i64>,
    crank_angle_udeg: Vec<i64>,
}

impl Times {
    pub fn push(&mut self, t_s: f64, step: u64, crank_angle_udeg: i64) {
        self.sim_time_ns.push((t_s * 1e9).round() as i64);
        self.step.push(i64::try_from(step).unwrap_or(i64::MAX));
        self.crank_angle_udeg.push(crank_angle_udeg);
    }

    pub fn len(&self) -> usize {
        self.step.len()
    }

    fn take(&mut self) -> [TimeColumn; 3] {
        let n = self.len();
        let taken = |v: &mut Vec<i64>| std::mem::replace(v, Vec::with_capacity(n));
        [
            TimeColumn::new_duration_nanos("sim_time", taken(&mut self.sim_time_ns)),
            TimeColumn::new_sequence("step", taken(&mut self.step)),
            TimeColumn::new_sequence("crank_angle", taken(&mut self.crank_angle_udeg)),
        ]
    }
}

impl EntityTable {
    pub fn new(entity: EntityPath, columns: Vec<(ComponentDescriptor, ComponentValues)>) -> EntityTable {
        let columns = columns.into_iter().map(|(descriptor, values)| ComponentColumn { descriptor, values }).collect();
        EntityTable { entity, lengths: Vec::new(), columns }
    }

    /// A table of plain numbers: components `group:name`.
    pub fn numbers(entity: &str, group: &'static str, columns: Vec<(&'static str, ComponentValues)>) -> EntityTable {
        EntityTable::new(
            entity.into(),
            columns.into_iter().map(|(name, values)| (number(group, name), values)).collect(),
        )
    }

    /// Adds a row: values of every column, in the order of the table.
    pub fn push_row(&mut self, columns: &[columns::ColumnValues<'_>]) {
        for (to, from) in self.columns.iter_mut().zip(columns) {
            to.values.extend(from);
        }
        self.end_row(columns.first().map_or(0, columns::ColumnValues::len));
    }

    /// Ends a row in which every column has received `n` values.
    pub fn end_row(&mut self, n: usize) {
        self.lengths.push(n);
    }

    pub fn f64(&mut self, column: usize) -> &mut Vec<f64> {
        match &mut self.columns[column].values {
            ComponentValues::F64(values) => values,
            ComponentValues::F32(_)
            | ComponentValues::Vec3(_)
            | ComponentValues::Quaternion(_)
            | ComponentValues::U16(_)
            | ComponentValues::U64(_)
            | ComponentValues::Bool(_)
            | ComponentValues::Text(_) => panic!("{} column {column} is not f64", self.entity),
        }
    }

    pub fn f32(&mut self, column: usize) -> &mut Vec<f32> {
        match &mut self.columns[column].values {
            ComponentValues::F32(values) | ComponentValues::Vec3(values) | ComponentValues::Quaternion(values) => {
                values
            }
            ComponentValues::F64(_)
            | ComponentValues::U16(_)
            | ComponentValues::U64(_)
            | ComponentValues::Bool(_)
            | ComponentValues::Text(_) => {
                panic!("{} column {column} is not f32", self.entity)
            }
        }
    }

    pub fn u16(&mut self, column: usize) -> &mut Vec<u16> {
        match &mut self.columns[column].values {
            ComponentValues::U16(values) => values,
            ComponentValues::F64(_)
            | ComponentValues::F32(_)
            | ComponentValues::Vec3(_)
            | ComponentValues::Quaternion(_)
            | ComponentValues::U64(_)
            | ComponentValues::Bool(_)
            | ComponentValues::Text(_) => panic!("{} column {column} is not u16", self.entity),
        }
    }

    pub fn u64(&mut self, column: usize) -> &mut Vec<u64> {
        match &mut self.columns[column].values {
            ComponentValues::U64(values) => values,
            ComponentValues::F64(_)
            | ComponentValues::F32(_)
            | ComponentValues::Vec3(_)
            | ComponentValues::Quaternion(_)
            | ComponentValues::U16(_)
            | ComponentValues::Bool(_)
            | ComponentValues::Text(_) => panic!("{} column {column} is not u64", self.entity),
        }
    }

    pub fn text(&mut self, column: usize) -> &mut Vec<String> {
        match &mut self.columns[column].values {
            ComponentValues::Text(values) => values,
            ComponentValues::F64(_)
            | ComponentValues::F32(_)
            | ComponentValues::Vec3(_)
            | ComponentValues::Quaternion(_)
            | ComponentValues::U16(_)
            | ComponentValues::U64(_)
            | ComponentValues::Bool(_) => panic!("{} column {column} is not text", self.entity),
        }
    }

    fn send(&mut self, stream: &RecordingStream, times: &[TimeColumn; 3]) -> Result<()> {
        let mut columns = Vec::with_capacity(self.columns.len());
        for column in &mut self.columns {
            let batch = SerializedComponentBatch::new(column.values.take(), column.descriptor.clone());
            columns.push(batch.partitioned(self.lengths.iter().copied())?);
        }
        self.lengths.clear();
        stream.send_columns(self.entity.clone(), times.clone(), columns)?;
        Ok(())
    }
}

/// A component that no viewer draws by default: `group:name`.
pub fn number(group: &'static str, name: &'static str) -> ComponentDescriptor {
    ComponentDescriptor {
        archetype: Some(group.into()),
        component: ComponentIdentifier::from_archetype_field(group.into(), name),
        component_type: None,
    }
}

/// Sends a block: the rows of all `tables`, at `times`; empties both.
pub fn send<'a>(
    stream: &RecordingStream,
    times: &mut Times,
    tables: impl IntoIterator<Item = &'a mut EntityTable>,
) -> Result<()> {
    let times = times.take();
    tables.into_iter().try_for_each(|table| table.send(stream, &times))
}

impl ComponentValues {
    /// An empty column for such values: a view shows 7 digits.
    pub fn like(values: &columns::ColumnValues<'_>) -> ComponentValues {
        match values {
            columns::ColumnValues::F64(_) => ComponentValues::F32(Vec::new()),
            columns::ColumnValues::U32(_) => ComponentValues::U16(Vec::new()),
            columns::ColumnValues::U64(_) => ComponentValues::U64(Vec::new()),
            columns::ColumnValues::Bool(_) => ComponentValues::Bool(Vec::new()),
            columns::ColumnValues::Text(_) => ComponentValues::Text(Vec::new()),
        }
    }

    fn extend(&mut self, values: &columns::ColumnValues<'_>) {
        match (self, values) {
            (ComponentValues::F32(to), columns::ColumnValues::F64(from)) => to.extend(from.iter().map(|v| *v as f32)),
            // No chain has more links or teeth than fit.
            (ComponentValues::U16(to), columns::ColumnValues::U32(from)) => {
                to.extend(from.iter().map(|v| u16::try_from(*v).unwrap_or(u16::MAX)));
            }
            (ComponentValues::U64(to), columns::ColumnValues::U64(from)) => to.extend_from_slice(from),
            (ComponentValues::Bool(to), columns::ColumnValues::Bool(from)) => to.extend_from_slice(from),
            (ComponentValues::Text(to), columns::ColumnValues::Text(from)) => to.extend_from_slice(from),
            (_, from) => panic!("a column of another kind than {from:?}"),
        }
    }

    fn take(&mut self) -> ArrayRef {
        match self {
            ComponentValues::F64(values) => Arc::new(Float64Array::from(taken(values))),
            ComponentValues::F32(values) => Arc::new(Float32Array::from(taken(values))),
            ComponentValues::Vec3(values) => small_vectors(taken(values), 3),
            ComponentValues::Quaternion(values) => small_vectors(taken(values), 4),
            ComponentValues::U16(values) => Arc::new(UInt16Array::from(taken(values))),
            ComponentValues::U64(values) => Arc::new(UInt64Array::from(taken(values))),
            ComponentValues::Bool(values) => Arc::new(BooleanArray::from(taken(values))),
            ComponentValues::Text(values) => Arc::new(StringArray::from(taken(values))),
        }
    }
}

/// Takes the values; the new capacity is slightly larger, because blocks have similar lengths.
fn taken<T>(values: &mut Vec<T>) -> Vec<T> {
    let n = values.len() + values.len() / 8;
    std::mem::replace(values, Vec::with_capacity(n))
}

fn small_vectors(values: Vec<f32>, width: i32) -> ArrayRef {
    let item = Arc::new(Field::new("item", DataType::Float32, false));
    Arc::new(FixedSizeListArray::new(item, width, Arc::new(Float32Array::from(values)), None))
}
