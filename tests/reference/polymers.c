/* Engagement of a tapping tip with a surface that it sticks to, in time.

   z'' + 2 (alpha0 + alpha_s) z' + z + F(d)/k = u0 cos(omega tau), d = z - z0, lengths in nm, F/k in nm.
   Three states: OUT (no contact), IN (contact, d > 0), NECK (contact, d < 0). Contact forms at d = 0 and breaks at
   `release`, which is 0 where there is no neck. In contact
   JKR     d = D (x^4 - 4 x), F/k = f (x^6 - 6 x^3), x >= 1, with D = s_c^4 / R; release at -3 D;
   MAUGIS  d = D delta(x), F/k = f phi(x), 0 < x <= fold: `dugdale`;
   DMT     F/k = f d^3/2 - D (d > 0), -D (d < 0).

   Method: Dormand and Prince's pair of order 8 with steps of adapted length. A step that passes a change of state, or
   a turning point beside one, is taken again with the length that ends on it. */
#include <math.h>
#include "tableau.h" /* STAGES, a[][], b[], c[], e3[], e5[] of the pair */

enum { OUT, IN, NECK };
enum { JKR, MAUGIS, DMT };
#define PI 3.14159265358979323846

typedef struct {
    double omega, alpha0, drive, pull, reach; /* pull: f0/k [nm]; 0, with a reach of 0: no long-range force */
    double force, depth, damping, tolerance;  /* of the contact: f, D, alpha1 / R^1/2; and of a step [nm] */
    double release, lambda, first, fold;      /* depth of release [nm]; Maugis' lambda; x at first contact and at most */
    double z0, z, v, theta, step, touched, zc, zs, x;
    int state, law;
} Tip;

/* Maugis (1992) as in theory, Eq. (model-9), with cos x = a / c. In C = (c/a) A his first equation is quadratic,
       lambda/2 C^2 p + 4/3 lambda^2 C q = 1,   p = sin(2x)/2 - x cos(2x),   q = x sin x + cos x - 1,
   and delta = C^2 cos^2 x - 4/3 lambda C sin x, phi = C^3 cos^3 x - lambda C^2 (sin x cos x + x). Also d delta / dx. */
void dugdale(double lambda, double x, double *delta, double *phi, double *slope) {
    double s = sin(x), c = cos(x), half = sin(0.5 * x), q = x * s - 2 * half * half;
    double p = s * c - x * (1 - 2 * s * s), y = 4 * x * x;
    if (x < 0.3) /* (sin y - y cos y) / 2 of 2x */
        p = x * y * (1. / 3 - y * (1. / 30 - y * (1. / 840 - y * (1. / 45360 - y * (1. / 3991680 - y / 518918400.)))));
    double b = 4. / 3 * lambda * lambda * q, root = sqrt(b * b + 2 * lambda * p), C = 2 / (b + root);
    double change = -C * (lambda * C * x * s * c * 2 + 4. / 3 * lambda * lambda * x * c) / (lambda * C * p + b);
    /* p' = 2 x sin 2x = 4 x s c and q' = x c */
    *delta = C * C * c * c - 4. / 3 * lambda * C * s;
    *phi = C * C * (C * c * c * c - lambda * (s * c + x));
    *slope = 2 * C * c * (c * change - C * s) - 4. / 3 * lambda * (change * s + C * c);
}

/* phi of the contact at depth d. delta falls with x up to the fold: Newton's method, within the brackets that it finds */
static double maugis(Tip *t, double d) {
    double goal = d / t->depth, low = 0, high = t->fold, x = t->x, delta, phi, slope;
    if (d <= t->release) x = high;
    else if (d == 0) x = t->first;
    if (!(x > low && x <= high)) x = 0.5 * high;
    for (int i = 0; i < 100; i++) {
        dugdale(t->lambda, x, &delta, &phi, &slope);
        if (d <= t->release || d == 0) break;
        if (delta > goal) low = x; else high = x;
        double change = (goal - delta) / slope;
        if (fabs(change) < 1e-8 * x && x + change <= t->fold) { /* quadratic: the next change would be 1e-16 */
            dugdale(t->lambda, x += change, &delta, &phi, &slope);
            break;
        }
        double next = x + change;
        if (!(next > low && next < high)) next = 0.5 * (low + high);
        if (next == x) break;
        x = next;
    }
    t->x = x;
    return phi;
}

/* x of the JKR contact at depth d: x^4 - 4 x = d / D */
static double root(Tip *t, double d) {
    double delta = d / t->depth, x = t->x;
    if (delta <= -3.0) return t->x = 1.0;
    if (delta < -1.0 || x < 1.3) { /* Ferrari: y^3 + 4 delta y - 16 = 0 */
        double q = 4.0 * delta / 3.0, s = 64.0 + q * q * q;
        double u = cbrt(8.0 + sqrt(s > 0 ? s : 0)), y = u - q / u, p = sqrt(y);
        double r = 8.0 / p - y;
        x = 0.5 * (p + sqrt(r > 0 ? r : 0));
        if (x < 1.2) return t->x = x;
    }
    for (int i = 0; i < 20; i++) {
        double change = (x * (x * x * x - 4.0) - delta) / (4.0 * (x * x * x - 1.0));
        x -= change;
        if (x < 1.05) x = 1.05;
        if (fabs(change) < 1e-9 * x) break; /* quadratic: the next change would be 1e-17 */
    }
    return t->x = x;
}

/* F/k in contact [nm] */
double contact(Tip *t, double d) {
    if (t->law == DMT) return (d > 0 ? t->force * d * sqrt(d) : 0.0) - t->depth;
    if (t->law == MAUGIS) return t->force * maugis(t, d);
    double x = root(t, d), cube = x * x * x;
    return t->force * cube * (cube - 6.0);
}

/* F/k out of contact [nm] */
double away(Tip *t, double d) {
    if (!(t->reach > 0)) return 0.0;
    double s = 1.0 - (d < 0.4 * t->reach ? d : 0.4 * t->reach) / t->reach; /* also a little beyond d = 0, for steps taken again */
    return -t->pull / (s * s);
}

static double acceleration(Tip *t, double theta, double z, double v, double *cosine, double *sine) {
    double d = z - t->z0, alpha = t->alpha0, f = t->state == OUT ? away(t, d) : contact(t, d);
    sincos(theta, sine, cosine);
    if (t->state == IN && d > 0) alpha += t->damping * sqrt(d);
    return t->drive * *cosine - 2.0 * alpha * v - z - f;
}

/* One step of length h from where the tip is; answers the error over the tolerance. to: z, v, zc, zs */
static double attempt(Tip *t, double h, double *to) {
    double kz[STAGES], kv[STAGES], qc[STAGES], qs[STAGES], cosine, sine;
    for (int i = 0; i < STAGES; i++) {
        double z = 0, v = 0;
        for (int j = 0; j < i; j++) { z += a[i][j] * kz[j]; v += a[i][j] * kv[j]; }
        z = t->z + h * z; v = t->v + h * v;
        kz[i] = v;
        kv[i] = acceleration(t, t->theta + t->omega * c[i] * h, z, v, &cosine, &sine);
        qc[i] = z * cosine; qs[i] = z * sine;
    }
    double s[4] = {0, 0, 0, 0}, e[4] = {0, 0, 0, 0};
    for (int i = 0; i < STAGES; i++) {
        s[0] += b[i] * kz[i]; s[1] += b[i] * kv[i]; s[2] += b[i] * qc[i]; s[3] += b[i] * qs[i];
        e[0] += e5[i] * kz[i]; e[1] += e5[i] * kv[i]; e[2] += e3[i] * kz[i]; e[3] += e3[i] * kv[i];
    }
    to[0] = t->z + h * s[0]; to[1] = t->v + h * s[1]; to[2] = h * s[2]; to[3] = h * s[3];
    double five = e[0] * e[0] + e[1] * e[1], three = e[2] * e[2] + e[3] * e[3];
    return five == 0 ? 0 : h * five / sqrt(five + 0.01 * three) / t->tolerance;
}

/* The same with sigma for the time, d = level + sign sigma^2 (Henon): ends on a depth without a search, and is smooth
   where force and damping are roots of d - level. to: time, v, zc, zs. The tip must not turn on the way. */
static double across(Tip *t, double level, double sign, double from, double until, double *to) {
    double kt[STAGES], kv[STAGES], qc[STAGES], qs[STAGES], cosine, sine, h = until - from;
    for (int i = 0; i < STAGES; i++) {
        double time = 0, v = 0, sigma = from + c[i] * h;
        for (int j = 0; j < i; j++) { time += a[i][j] * kt[j]; v += a[i][j] * kv[j]; }
        time *= h; v = t->v + h * v;
        if (v * t->v <= 0) return 1e9;
        double d = level + sign * sigma * sigma, z = t->z0 + d;
        kt[i] = 2 * sign * sigma / v;
        kv[i] = kt[i] * acceleration(t, t->theta + t->omega * time, z, v, &cosine, &sine);
        qc[i] = kt[i] * z * cosine; qs[i] = kt[i] * z * sine;
    }
    double s[4] = {0, 0, 0, 0}, e[4] = {0, 0, 0, 0};
    for (int i = 0; i < STAGES; i++) {
        s[0] += b[i] * kt[i]; s[1] += b[i] * kv[i]; s[2] += b[i] * qc[i]; s[3] += b[i] * qs[i];
        e[0] += e5[i] * kt[i]; e[1] += e5[i] * kv[i]; e[2] += e3[i] * kt[i]; e[3] += e3[i] * kv[i];
    }
    to[0] = h * s[0]; to[1] = t->v + h * s[1]; to[2] = h * s[2]; to[3] = h * s[3];
    double v2 = t->v * t->v, five = v2 * e[0] * e[0] + e[1] * e[1], three = v2 * e[2] * e[2] + e[3] * e[3];
    if (!(to[1] * t->v > 0)) return 1e9;
    return five == 0 ? 0 : fabs(h) * five / sqrt(five + 0.01 * three) / t->tolerance;
}

/* The length of the step, below h, that ends where the depth is `level`, or the tip turns (turn) */
static double located(Tip *t, double h, double level, int turn, double *to) {
    double low = 0, high = h, x = 0.5 * h, cosine, sine;
    double start = turn ? t->v : t->z - t->z0 - level;
    double end = turn ? to[1] : to[0] - t->z0 - level;
    x = h * start / (start - end);
    if (!(x > 0.001 * h && x < 0.999 * h)) x = 0.5 * h;
    for (int i = 0; i < 60; i++) {
        attempt(t, x, to);
        double value = turn ? to[1] : to[0] - t->z0 - level;
        double slope = turn ? acceleration(t, t->theta + t->omega * x, to[0], to[1], &cosine, &sine) : to[1];
        if (fabs(value) < 1e-13 * (fabs(t->z0) + 10) || high - low < 1e-15) break;
        if ((value > 0) == (end > 0)) high = x; else low = x;
        x = x - value / slope;
        if (!(x > low && x < high)) x = 0.5 * (low + high);
    }
    return x;
}

/* One period of the drive. The phasor of z, less its mean, is (zc - i zs) / pi */
static void period(Tip *t) {
    double end = 2 * PI / t->omega, now = 0, to[4];
    t->theta = 0; t->zc = t->zs = 0;
    double release = t->release;
    int below = release < 0 ? NECK : OUT; /* after IN */
    int touched = t->state != OUT, fresh = 0;
    while (now < end - 1e-14) {
        double h = t->step, here = t->z - t->z0;
        int last = 0;
        /* straight to the change of state that lies ahead, or away from the one just passed */
        int ahead = -1; double goal = 0;
        if (t->state == OUT && t->v > 0) ahead = IN;
        else if (t->state == IN && t->v < 0) ahead = below;
        else if (t->state == NECK && t->v > 0) ahead = IN;
        else if (t->state == NECK && t->v < 0) { ahead = OUT; goal = release; }
        double sign = here > goal || (here == goal && t->v > 0) ? 1 : -1;
        if (ahead >= 0 && here != goal && fabs(here - goal) < 1.2 * h * fabs(t->v)) {
            double error = across(t, goal, sign, sqrt(fabs(here - goal)), 0, to);
            if (error <= 1 && now + to[0] < end) {
                t->z = t->z0 + goal; t->v = to[1]; t->zc += to[2]; t->zs += to[3];
                now += to[0]; t->theta = t->omega * now;
                t->state = ahead; fresh = 1;
                if (ahead == NECK || ahead == IN) t->x = t->first;
                if (ahead != OUT) touched = 1;
                continue;
            }
            double most = 0.6 * fabs((here - goal) / t->v);
            if (h > most) h = most;
        } else if (fresh && t->state == IN) {
            double reach = sqrt(t->v * (h < 0.01 ? 0.01 : h));
            int done = 0;
            for (int i = 0; i < 8 && !done; i++, reach *= 0.6) {
                double error = across(t, 0, 1, 0, reach, to);
                if (error <= 1 && now + to[0] < end) {
                    t->z = t->z0 + reach * reach; t->v = to[1]; t->zc += to[2]; t->zs += to[3];
                    now += to[0]; t->theta = t->omega * now; done = 1;
                    if (t->step < to[0]) t->step = to[0];
                }
            }
            fresh = 0;
            if (done) continue;
        }
        fresh = 0;
        if (now + h >= end) { h = end - now; last = 1; }
        double error = attempt(t, h, to);
        if (!(error <= 1)) {
            double f = error > 0 ? 0.9 * pow(error, -0.125) : 0.1;
            t->step = h * (f > 0.2 ? f : 0.2);
            if (t->step > 1e-13) continue;
        } else if (!last || error > 0.5) {
            double f = error > 1e-8 ? 0.9 * pow(error, -0.125) : 6.0;
            t->step = h * (f < 6.0 ? f : 6.0);
            if (t->step > 0.25) t->step = 0.25;
        }
        double d = t->z - t->z0, e = to[0] - t->z0, near = 0.5 * (t->reach - 2. / 3 * release) + 1.0;
        int next = t->state;
        double taken = h;
        /* turning beside a change of state: end the step there first */
        if (t->v * to[1] < 0 && e < near && e > release - near
            && !(t->state == OUT && (e >= 0 || t->v < 0)) && !(t->state == IN && (e < 0 || t->v > 0))
            && !(t->state == NECK && (e >= 0 || e < release))) {
            taken = located(t, h, 0, 1, to);
            to[1] = 0;
            e = to[0] - t->z0;
        }
        double level = 0;
        if (t->state == OUT && e >= 0) next = IN;
        else if (t->state == IN && e < 0) next = below;
        else if (t->state == NECK && e >= 0) next = IN;
        else if (t->state == NECK && e < release) { next = OUT; level = release; }
        if (next != t->state && d != e) {
            taken = located(t, taken, level, 0, to);
            to[0] = t->z0 + level;
        }
        t->z = to[0]; t->v = to[1]; t->zc += to[2]; t->zs += to[3];
        now += taken; t->theta = t->omega * now;
        if (next != t->state) {
            t->state = next; fresh = 1;
            if (next != OUT) t->x = next == IN ? t->first : t->x;
        }
        if (t->state != OUT) touched = 1;
    }
    t->touched = touched;
}

/* n periods under a feedback: the tip offset falls by gain (A - setpoint) a ring-down, at most by `rate`.
   slow: 4 numbers kept between calls: the low-passed phasor (2), a lock-in of 0.01 of the drive frequency (2).
   rows: n rows of x, y of the phasor of each period, z0, touched, and x, y behind the lock-in, or null.  until: stops where the
   low-passed amplitude falls below it. Answers the periods done. */
long follow(Tip *t, double *slow, double setpoint, double gain, double rate, double until, long n, double *rows) {
    double ring = 1.0 / (2 * PI / t->omega * t->alpha0); /* periods */
    double weight = -expm1(-1.0 / ring), narrow = -expm1(-2 * PI * 0.01);
    for (long i = 0; i < n; i++) {
        period(t);
        double x = t->zc * t->omega / PI, y = -t->zs * t->omega / PI;
        slow[0] += weight * (x - slow[0]); slow[1] += weight * (y - slow[1]);
        slow[2] += narrow * (x - slow[2]); slow[3] += narrow * (y - slow[3]);
        if (rows) {
            double *r = rows + 6 * i;
            r[0] = x; r[1] = y; r[2] = t->z0; r[3] = t->touched; r[4] = slow[2]; r[5] = slow[3];
        }
        double amplitude = hypot(slow[0], slow[1]);
        if (amplitude < until) return i + 1;
        double change = gain * (amplitude - setpoint);
        change = change > rate ? rate : change < -rate ? -rate : change;
        t->z0 -= change / ring;
        if (!(fabs(t->z) < 1e6)) return -1;
    }
    return n;
}
