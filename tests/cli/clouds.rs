//! `lanesim bench-clouds`.

use super::{Folder, fails, json, succeeds};

#[test]
fn clouds_have_the_papers_sizes_and_the_errors_of_their_differences() {
    let folder = Folder::new("clouds");
    let file = folder.path("clouds.json");
    let args = ["bench-clouds", "--quick", "--no-mujoco", "--threads", "2", "--json", "-o", &file];
    let printed = json(&succeeds(&args));
    assert_eq!(printed, json(&std::fs::read_to_string(&file).unwrap()));
    let rows = printed["rows"].as_array().unwrap();
    // Both dynamics, one thread and two, both precisions.
    assert_eq!(rows.len(), 8);
    for row in rows {
        let number = |value: &serde_json::Value| value.as_f64().unwrap();
        assert_eq!(row["states"], json(r#"{"cost": 30, "gradient": 3150, "hessian": 42930}"#));
        assert_eq!((number(&row["contacts"]), number(&row["contacts_found"])), (6.0, 6.0));
        assert!(number(&row["states_judged"]) >= 25.0, "{row}");
        for what in ["cost", "gradient", "hessian", "hessian_whole"] {
            assert!(number(&row["seconds"][what]) > 0.0, "{row}");
        }
        let bounds = if row["engine"] == "f64" { [1e-7, 1e-3] } else { [0.5, 5.0] };
        for (name, bound) in ["gradient_error", "hessian_error"].iter().zip(bounds) {
            assert!(number(&row[*name][0]) < bound, "{name} {row}");
        }
    }
}

#[test]
fn bench_clouds_prints_three_tables() {
    let text = succeeds(&["bench-clouds", "--quick", "--no-mujoco", "--threads", "1"]);
    for words in ["Table 1: ", "Table 2: ", "Table 3: ", "| gradient, 3150 states | Hessian, 42930 states |"] {
        assert!(text.contains(words), "{words}: {text}");
    }
    fails(&["bench-clouds", "--threads", "0"], 2, "0 is not in 1..");
    fails(&["bench-clouds", "-o", "no/such/folder/clouds.json"], 1, "no/such/folder");
}
