//! JSON values as objects of Python.
//!
//! In: a value as the command line prints it. Out: dicts, lists, numbers, strings, booleans and `None`,
//! as `json.loads` makes them of the printed text. Cost: an object of Python for each value.

use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use serde_json::{Number, Value};

/// A value as an object of Python.
pub fn object<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    match value {
        Value::Null => Ok(py.None().into_bound(py)),
        Value::Bool(v) => v.into_bound_py_any(py),
        Value::Number(v) => number(py, v),
        Value::String(v) => v.into_bound_py_any(py),
        Value::Array(values) => {
            let values = values.iter().map(|v| object(py, v)).collect::<PyResult<Vec<_>>>()?;
            Ok(PyList::new(py, values)?.into_any())
        }
        Value::Object(entries) => {
            let dict = PyDict::new(py);
            for (key, value) in entries {
                dict.set_item(key, object(py, value)?)?;
            }
            Ok(dict.into_any())
        }
    }
}

fn number<'py>(py: Python<'py>, v: &Number) -> PyResult<Bound<'py, PyAny>> {
    match (v.as_u64(), v.as_i64()) {
        (Some(v), _) => v.into_bound_py_any(py),
        (_, Some(v)) => v.into_bound_py_any(py),
        _ => v.as_f64().into_bound_py_any(py),
    }
}
