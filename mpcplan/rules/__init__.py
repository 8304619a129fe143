"""Traffic rules in temporal logic: predicates, formulas, their robustness, and who kept them.

Source: Maierhofer, Rettinger, Mayer, Althoff: Formalization of interstate traffic rules in temporal
logic, IEEE IV 2020 (rules R_G1, safe distance, and R_G4, traffic flow).
"""
