"""Export a flight as tables: truth, measurements and errors as Parquet and CSV."""

import pyarrow.csv
import pyarrow.parquet

import laisn_sim

flight = laisn_sim.fly("T5", {"duration_s": 60})
tables = {
    "truth": laisn_sim.truth(flight),
    "measurements": laisn_sim.measurements(flight),
    "errors": laisn_sim.errors(flight),
}
for name, table in tables.items():
    pyarrow.parquet.write_table(table.arrow, f"{name}.parquet")
    pyarrow.csv.write_csv(table.arrow, f"{name}.csv")
    print(f"{name}: {len(table)} rows of {', '.join(table.columns[:6])}, …")
flight.draw("errors.png")
