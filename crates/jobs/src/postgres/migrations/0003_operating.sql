-- The type of the problem of a failed job, by which operators search.
ALTER TABLE jobs ADD COLUMN problem_type text COLLATE "C"
    GENERATED ALWAYS AS (substring(problem FROM '"type":"([^"]*)"')) STORED;
CREATE INDEX jobs_with_problem ON jobs (problem_type, id) WHERE problem_type IS NOT NULL;
-- Serves searches over all owners.
CREATE INDEX jobs_in_state ON jobs (state, id);
-- Pictures of failed jobs are kept, too.
DROP INDEX jobs_with_image;
CREATE INDEX jobs_with_image ON jobs (image_digest) WHERE state IN (0, 1, 3);
-- What an operator has paused: one row.
CREATE TABLE paused (
    id integer NOT NULL PRIMARY KEY CHECK (id = 0),
    intake boolean NOT NULL,
    work boolean NOT NULL
);
