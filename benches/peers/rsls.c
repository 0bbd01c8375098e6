static char help[] =
    "Steps of a plate over an obstacle, each solved by SNESVINEWTONRSLS as PETSc's tutorials do.\n"
    "-data FILE: stiffness, mass, load, start, and the numbers of the deflections (PETSc's binary format)\n"
    "-obstacle HEIGHT -step SECONDS -steps COUNT -dof NUMBER\n";

#include <petscsnes.h>

typedef struct {
    Mat matrix; /* M / dt^2 + K / 2 */
    Vec rhs;    /* F - K U^n */
} Step;

static PetscErrorCode residual(SNES snes, Vec x, Vec f, void *context)
{
    Step *step = (Step *)context;
    PetscFunctionBeginUser;
    PetscCall(MatMult(step->matrix, x, f));
    PetscCall(VecAXPY(f, -1.0, step->rhs));
    PetscFunctionReturn(0);
}

/* The matrix is constant. */
static PetscErrorCode jacobian(SNES snes, Vec x, Mat a, Mat p, void *context)
{
    PetscFunctionBeginUser;
    PetscFunctionReturn(0);
}

int main(int argc, char **argv)
{
    char name[PETSC_MAX_PATH_LEN];
    PetscReal obstacle = -1, dt = 1e-4;
    PetscInt steps = 20, dof = 0, count;
    PetscViewer file;
    Mat stiffness, mass;
    Vec load, u, free_flight, last, numbers, x, f, lower, upper;
    const PetscScalar *number;
    Step step;
    SNES snes;
    SNESConvergedReason reason;
    PetscLogDouble began, ended;

    PetscFunctionBeginUser;
    PetscCall(PetscInitialize(&argc, &argv, NULL, help));
    PetscCall(PetscOptionsGetString(NULL, NULL, "-data", name, sizeof name, NULL));
    PetscCall(PetscOptionsGetReal(NULL, NULL, "-obstacle", &obstacle, NULL));
    PetscCall(PetscOptionsGetReal(NULL, NULL, "-step", &dt, NULL));
    PetscCall(PetscOptionsGetInt(NULL, NULL, "-steps", &steps, NULL));
    PetscCall(PetscOptionsGetInt(NULL, NULL, "-dof", &dof, NULL));

    PetscCall(PetscViewerBinaryOpen(PETSC_COMM_SELF, name, FILE_MODE_READ, &file));
    PetscCall(MatCreate(PETSC_COMM_SELF, &stiffness));
    PetscCall(MatLoad(stiffness, file));
    PetscCall(MatCreate(PETSC_COMM_SELF, &mass));
    PetscCall(MatLoad(mass, file));
    PetscCall(VecCreate(PETSC_COMM_SELF, &load));
    PetscCall(VecLoad(load, file));
    PetscCall(VecCreate(PETSC_COMM_SELF, &u));
    PetscCall(VecLoad(u, file));
    PetscCall(VecCreate(PETSC_COMM_SELF, &numbers));
    PetscCall(VecLoad(numbers, file));
    PetscCall(PetscViewerDestroy(&file));

    PetscCall(MatDuplicate(mass, MAT_COPY_VALUES, &step.matrix));
    PetscCall(MatScale(step.matrix, 1.0 / (dt * dt)));
    PetscCall(MatAXPY(step.matrix, 0.5, stiffness, UNKNOWN_NONZERO_PATTERN));
    PetscCall(MatSetOption(step.matrix, MAT_SPD, PETSC_TRUE));
    PetscCall(VecDuplicate(u, &step.rhs));
    PetscCall(VecDuplicate(u, &x));
    PetscCall(VecDuplicate(u, &f));
    PetscCall(VecDuplicate(u, &free_flight));
    PetscCall(VecDuplicate(u, &last));
    PetscCall(VecDuplicate(u, &lower));
    PetscCall(VecDuplicate(u, &upper));
    PetscCall(VecGetLocalSize(numbers, &count));
    PetscCall(VecGetArrayRead(numbers, &number));

    PetscCall(SNESCreate(PETSC_COMM_SELF, &snes));
    PetscCall(SNESSetType(snes, SNESVINEWTONRSLS));
    PetscCall(SNESSetFunction(snes, f, residual, &step));
    PetscCall(SNESSetJacobian(snes, step.matrix, step.matrix, jacobian, &step));
    PetscCall(SNESSetFromOptions(snes));

    /* The velocity is 0 at the start: U^{-1} = U^1, and x = 2 (U^1 - U^0). */
    PetscCall(VecCopy(u, free_flight));
    PetscCall(PetscTime(&began));
    for (PetscInt n = 0; n < steps; n++) {
        PetscReal scale = n == 0 ? 2.0 : 1.0;
        const PetscScalar *reached;
        PetscScalar *bound;
        PetscCall(MatMult(stiffness, u, step.rhs));
        PetscCall(VecAYPX(step.rhs, -1.0, load));
        PetscCall(VecSet(lower, PETSC_NINFINITY));
        PetscCall(VecSet(upper, PETSC_INFINITY));
        PetscCall(VecGetArrayRead(free_flight, &reached));
        PetscCall(VecGetArray(lower, &bound));
        for (PetscInt i = 0; i < count; i++) {
            PetscInt bounded = (PetscInt)PetscRealPart(number[i]);
            bound[bounded] = scale * (obstacle - reached[bounded]);
        }
        PetscCall(VecRestoreArray(lower, &bound));
        PetscCall(VecRestoreArrayRead(free_flight, &reached));
        PetscCall(SNESVISetVariableBounds(snes, lower, upper));
        PetscCall(VecSet(x, 0.0));
        PetscCall(SNESSolve(snes, NULL, x));
        PetscCall(SNESGetConvergedReason(snes, &reason));
        PetscCheck(reason > 0, PETSC_COMM_SELF, PETSC_ERR_NOT_CONVERGED, "step %d: %s", (int)n, SNESConvergedReasons[reason]);
        PetscCall(VecCopy(u, last));
        PetscCall(VecWAXPY(u, 1.0 / scale, x, free_flight));
        PetscCall(VecCopy(u, free_flight));
        PetscCall(VecScale(free_flight, 2.0));
        PetscCall(VecAXPY(free_flight, -1.0, last));
    }
    PetscCall(PetscTime(&ended));

    PetscCall(VecGetArrayRead(u, &number));
    PetscCall(PetscPrintf(PETSC_COMM_SELF, "%.17g %.6g\n", (double)PetscRealPart(number[dof]), (ended - began) / steps));
    PetscCall(VecRestoreArrayRead(u, &number));
    PetscCall(PetscFinalize());
    return 0;
}
