"""The study of the estimators: LAISN-2, the tightly coupled navigator and the Cramér–Rao bound, on the same noise.

Takes the paper's point motion and sensors, physical missions, and what can go wrong (`cases`); plans tasks (`plan`),
flies each by both navigators (`paired`), and writes a record and a page (`study`, `report`, `figures`).

Imports: experiments.campaign experiments.findings experiments.flight experiments.intervals experiments.pages
experiments.reproduction laisn sim
"""
